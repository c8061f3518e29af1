"""``tactile keys``: the keys by which machines know each other when a bridge connects them."""

from __future__ import annotations

import argparse
import sys

DESCRIPTION = 'Make and show the keys by which machines know each other; see the parameters of bridge_node.'
EPILOG = """\
on each of two machines:
  tactile keys create robot           (lab, on the other one)
  tactile keys show                   which keys there are, by their SHA-256 fingerprints
  tactile keys show robot             prints the public key, for the file robot.key of the other machine, say with
                                      ssh robot tactile keys show robot > ~/.config/tactile_nodes/keys/robot.key
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of the verb."""
    actions = parser.add_subparsers(dest='action', required=True, metavar='create|show')
    create = actions.add_parser('create', help='make a pair of keys; those that exist are never overwritten')
    create.add_argument('name', help="the machine's name, say")
    show = actions.add_parser('show', help='list keys, or print a public one; secret ones stay where they are')
    show.add_argument('name', nargs='?', help='print the public key of this name')


def run(arguments: argparse.Namespace) -> int:
    """Make keys, or show them."""
    from tactile_nodes.bus.bridge.keys import create_keys, read_public

    if arguments.action == 'create':
        public, secret = create_keys(arguments.name)
        print(f'public key, for the other machine:  {public}\nsecret key, for this machine alone: {secret}')
        return 0
    if arguments.name:
        print(read_public(arguments.name).decode(), end='')
        return 0
    return _list()


def _list() -> int:
    """What is no key is named, and hides none that is."""
    from tactile_nodes.bus.bridge.keys import fingerprint, keys_directory, read_public
    from tactile_nodes.errors import ConfigurationError

    folder = keys_directory()
    names = sorted(file.stem for file in folder.glob('*.key'))
    if not names:
        raise ConfigurationError(f'there are no keys in {folder}; make some with: tactile keys create NAME')
    for name in names:
        mine = 'own' if (folder / f'{name}.key_secret').exists() else 'of another machine'
        try:
            print(f'{name}  {fingerprint(read_public(name))}  {mine}')
        except ConfigurationError as error:
            print(f'Warning: {name}.key is left out: {error}', file=sys.stderr)
    return 0
