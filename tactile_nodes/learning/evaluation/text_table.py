"""A table of text. It imports nothing, because every process of a benchmark imports it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Cells as text, with a title above them."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __str__(self) -> str:
        """The table as aligned text: the first column to the left, the others to the right."""
        lines = ['  '.join(cells).rstrip() for cells in self._padded()]
        return '\n'.join([*([self.title] if self.title else []), *lines])

    def markdown(self) -> str:
        """The same as Markdown, without its title.

        >>> print(Table('', ('a', 'bcd'), (('xy', '1'),)).markdown())
        | a  | bcd |
        | -- | --: |
        | xy |   1 |
        """
        heads, *rows = self._padded()
        rule = ['-' * len(heads[0]), *('-' * (len(head) - 1) + ':' for head in heads[1:])]
        return '\n'.join(f'| {" | ".join(cells)} |' for cells in (heads, rule, *rows))

    def _padded(self) -> list[list[str]]:
        lines = [self.heads, *self.rows]
        widths = [max(len(line[column]) for line in lines) for column in range(len(self.heads))]
        return [[line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])] for line in lines]
