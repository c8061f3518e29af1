"""Every code block of the documents names its language and is right in it."""

from __future__ import annotations

import ast
import csv
import functools
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from blocks import Block, blocks, commands, script

from tactile_nodes.cli import launch
from tactile_nodes.cli.main import chosen_verb, make_parser, parse
from tactile_nodes.errors import TactileError
from tactile_nodes.launching import description, files

BLOCKS = blocks()
PARSER_OF = functools.cache(make_parser)


def check_shell(block: Block) -> None:
    ended = subprocess.run(['bash', '-n'], input=script(block), capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def check_python(block: Block) -> None:
    ast.parse(block.text)


def check_yaml(block: Block) -> None:
    assert isinstance(yaml.safe_load(block.text), dict | list)


def check_csv(block: Block) -> None:
    rows = list(csv.reader(block.text.splitlines()))
    assert len({len(row) for row in rows}) == 1


def check_javascript(block: Block) -> None:
    if (node := shutil.which('node')) is None:
        pytest.skip('Node.js is not installed')
    subprocess.run([node, '--check', '-'], input=block.text, text=True, check=True)


LANGUAGES = {
    'sh': check_shell,
    'console': check_shell,
    'python': check_python,
    'yaml': check_yaml,
    'csv': check_csv,
    'js': check_javascript,
    'cpp': lambda block: None,  # sketches for boards whose libraries are not here
    'msg': lambda block: None,  # made from msg/, and compared with it in test/cli/test_reference_pages.py
    'text': lambda block: None,
}


@pytest.mark.parametrize('page', dict.fromkeys(block.file for block in BLOCKS), ids=lambda page: page.name)
def test_code_blocks_of_a_page_name_their_language_and_parse(page: Path) -> None:
    for block in (each for each in BLOCKS if each.file == page):
        assert block.language in LANGUAGES, f'{block} is not fenced, or names no language that the suite can parse'
        LANGUAGES[block.language](block)


def tactile_commands() -> list[str]:
    shells = [block for block in BLOCKS if block.language in {'sh', 'console'}]
    found = [command for block in shells for command in commands(block)]
    return sorted({command.removesuffix(' &') for command in found if command.startswith('tactile ')})


def test_commands_of_the_documents_are_those_that_the_program_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of two hundred commands fifty are launches, most of them of the same file.
    monkeypatch.setattr(description, 'read_file', functools.cache(description.read_file))
    refused = {}
    for command in tactile_commands():
        try:
            require_taken(command)
        except (SystemExit, TactileError, AssertionError) as error:
            refused[command] = error
    assert not refused


def require_taken(command: str) -> None:
    words = shlex.split(re.split(r' [>|] ', command, maxsplit=1)[0])[1:]
    verb = chosen_verb(words)
    arguments = parse(PARSER_OF(verb), verb, words)
    if verb == 'launch':
        file, given = files.resolve(arguments.words, os.environ)
        launch.refuse_unknown(file, files.parse_arguments(given))
    if verb == 'train' and arguments.config:
        assert Path(arguments.config).name == 'run.yaml' or Path(arguments.config).is_file()
