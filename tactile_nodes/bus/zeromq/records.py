"""What one participant says of itself to the others, as the text of a file that anybody may have damaged."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, cast

from tactile_nodes.bus.protocol import Endpoint, Participant

FORMAT = 3
LONGEST_TEXT = 4_000_000
_ROLES = ('publishers', 'subscriptions', 'services')


@dataclass(frozen=True)
class Outlet:
    """Where one publisher's messages can be had; `gid` is who sends them, on whichever machine."""

    gid: str
    topic: str
    type_name: str
    address: str
    latched: bool = False


@dataclass(frozen=True)
class Record:
    """A participant, its outlets, the address that answers its calls, and whom a bridge speaks for (`remotes`)."""

    participant: Participant
    outlets: tuple[Outlet, ...]
    service_address: str
    remotes: tuple[Participant, ...] = ()

    def to_json(self) -> str:
        return json.dumps({'format': FORMAT, **asdict(self)})

    @classmethod
    def from_json(cls, text: str, address_prefix: str) -> Record:
        """The record that `text` holds, if all its addresses are ``<address_prefix>.<number>.sock``.

        Raises:
            ValueError: it is none.
        """
        try:
            fields = json.loads(text)
            if fields['format'] != FORMAT:
                raise ValueError(f'format {fields["format"]}')
            outlets = tuple(checked(Outlet, entry) for entry in fields['outlets'])
            remotes = tuple(participant_from(entry) for entry in fields['remotes'])
            record = cls(participant_from(fields['participant']), outlets, fields['service_address'], remotes)
            addresses = [record.service_address, *(outlet.address for outlet in outlets)]
            own = re.compile(re.escape(address_prefix) + r'\.[0-9]{1,7}\.sock', re.ASCII)
            if not all(own.fullmatch(address) for address in addresses):
                raise ValueError('an address that is not its own')
        except (KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f'not a record: {error}') from error
        return record


def participant_from(fields: Any) -> Participant:
    """A participant from parsed JSON. Raises ValueError, KeyError, TypeError or AttributeError when it is none."""
    ends = {role: tuple(checked(Endpoint, end) for end in fields[role]) for role in _ROLES}
    nodes = tuple(_strings(fields['nodes']))
    return cast(Participant, checked(Participant, {**fields, **ends, 'nodes': nodes}))


def checked(kind: type[Any], fields: dict[str, Any]) -> Any:
    """An instance of the dataclass `kind`, whose plain fields have the types that it says. Raises TypeError."""
    for name, hint in kind.__annotations__.items():
        wanted = {'str': str, 'int': int, 'bool': bool}.get(hint)
        if wanted is not None and name in fields and type(fields[name]) is not wanted:
            raise TypeError(f'{name} is {fields[name]!r}')
    return kind(**fields)


def _strings(values: Iterable[Any]) -> Iterable[str]:
    for value in values:
        if not isinstance(value, str):
            raise TypeError(f'{value!r} is no name')
        yield value
