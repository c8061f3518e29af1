"""The code blocks of the documents, and the commands in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
FILES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md'), *ROOT.glob('examples/*.md')])
PROMPT = re.compile(r'^(\w+)?\$ +')


@dataclass(frozen=True)
class Block:
    """One code block: where it stands, and its language; empty for one that names none."""

    file: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f'{self.file.relative_to(ROOT)}:{self.line}'


@cache
def blocks() -> tuple[Block, ...]:
    """All code blocks, fenced or indented."""
    parser = MarkdownIt().disable('inline')  # which takes most of the time
    return tuple(
        Block(file, (token.map or [0])[0] + 1, token.info.strip() if token.type == 'fence' else '', token.content)
        for file in FILES
        for token in parser.parse(file.read_text(encoding='utf-8'))
        if token.type in {'fence', 'code_block'}
    )


def script(block: Block) -> str:
    """What a shell gets: of a dialogue (`console`) the lines after a prompt, without it."""
    if block.language == 'sh':
        return block.text
    lines, kept, going_on = block.text.splitlines(), [], False
    for line in lines:
        if PROMPT.match(line) or going_on:
            kept.append(PROMPT.sub('', line))
            going_on = line.endswith('\\')
    return '\n'.join(kept)


def commands(block: Block) -> list[str]:
    """The commands of a shell block, each on one line, without comments."""
    joined = script(block).replace('\\\n', ' ')
    stripped = (re.sub(r'(^|\s)#.*$', '', line).strip() for line in joined.splitlines())
    return [line for line in stripped if line]
