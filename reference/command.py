"""Renews, checks or prints the parts of the documentation that are generated from the code."""

from __future__ import annotations

import argparse
from pathlib import Path

from reference import commands as reference_commands
from reference import parameters as reference_parameters
from reference import rooms
from reference import topics as reference_topics
from reference.pages import Make, pages, renewed
from tactile_nodes.paths import share_directory

PARTS: dict[str, Make] = {
    'topics': reference_topics.topics,
    'ends': reference_topics.ends,
    'services': reference_topics.services,
    'messages': reference_topics.messages,
    'nodes': reference_parameters.nodes,
    'parameters': reference_parameters.parameters,
    'launch-arguments': reference_parameters.launch_arguments,
    'verbs': reference_commands.verbs,
    'flags': reference_commands.flags,
    'rooms': rooms.rooms,
    'imports': rooms.imports,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        '-o', '--output', type=Path, metavar='DIR', help='folder of the pages (default: docs/ of this source tree)'
    )
    parser.add_argument('--check', action='store_true', help='only print which pages are not current')
    parser.add_argument('--print', choices=sorted(PARTS), dest='part', help='print one part instead')


def run(arguments: argparse.Namespace) -> int:
    """Renew, check or print; returns 1 if a checked page is out of date."""
    if arguments.part:
        print(PARTS[arguments.part]())
        return 0
    stale = stale_pages(arguments.output or share_directory() / 'docs')
    for page, text in stale.items():
        if not arguments.check:
            page.write_text(text, encoding='utf-8')
        print(f'{page} is not current; renew it with: tactile reference' if arguments.check else f'renewed {page}')
    if not stale:
        print('all pages are current')
    return int(arguments.check and bool(stale))


def stale_pages(folder: Path) -> dict[Path, str]:
    """The pages of `folder` that are out of date, with the text that they should have.

    Raises:
        ConfigurationError: there are no pages, or a page has a part that cannot be generated.
    """
    texts = {page: page.read_text(encoding='utf-8') for page in pages(folder)}
    made = {page: renewed(text, PARTS, page.name) for page, text in texts.items()}
    return {page: text for page, text in made.items() if text != texts[page]}
