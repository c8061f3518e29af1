"""``tactile keys``: the keys with which machines authenticate each other when a bridge connects them."""

from __future__ import annotations

import argparse
import sys

DESCRIPTION = 'Create and show the keys with which machines authenticate each other; see the parameters of bridge_node.'
EPILOG = """\
on each of two machines:
  tactile keys create robot           (on the other machine: lab)
  tactile keys show                   list the keys with their SHA-256 fingerprints
  tactile keys show robot             print the public key, for the file robot.key of the other machine; for example
                                      ssh robot tactile keys show robot > ~/.config/tactile_nodes/keys/robot.key
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest='action', required=True, metavar='create|show')
    create = actions.add_parser('create', help='create a pair of keys; existing keys are never overwritten')
    create.add_argument('name', help='for example the name of the machine')
    show = actions.add_parser('show', help='list keys, or print a public key; secret keys are never printed')
    show.add_argument('name', nargs='?', help='print the public key of this name')


def run(arguments: argparse.Namespace) -> int:
    """Create or print keys, or list them. Invalid files are reported and do not hide valid keys."""
    from tactile_nodes.bus.bridge.keys import create_keys, fingerprint, keys_directory, read_public
    from tactile_nodes.errors import ConfigurationError

    if arguments.action == 'create':
        public, secret = create_keys(arguments.name)
        print(f'public key, for the other machine:  {public}\nsecret key, for this machine only: {secret}')
        return 0
    if arguments.name:
        print(read_public(arguments.name).decode(), end='')
        return 0
    folder = keys_directory()
    names = sorted(file.stem for file in folder.glob('*.key'))
    if not names:
        raise ConfigurationError(f'no keys in {folder}; create some with: tactile keys create NAME')
    for name in names:
        mine = 'own' if (folder / f'{name}.key_secret').exists() else 'of another machine'
        try:
            print(f'{name}  {fingerprint(read_public(name))}  {mine}')
        except ConfigurationError as error:
            print(f'Warning: {name}.key was skipped: {error}', file=sys.stderr)
    return 0
