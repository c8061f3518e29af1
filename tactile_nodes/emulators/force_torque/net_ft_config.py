"""Settings of an emulated ATI Net F/T box, its ``netftapi2.xml``, and its page that changes the rate."""

from __future__ import annotations

import dataclasses
import urllib.parse
from dataclasses import dataclass

INTERNAL_RATE_HZ = 7000

FORCE_UNIT_N = {'lbf': 4.4482216152605, 'N': 1.0, 'klbf': 4448.2216152605, 'kN': 1e3, 'kg': 9.80665, 'g': 0.00980665}
TORQUE_UNIT_NM = {
    'lbf-in': 0.1129848290276, 'lbf-ft': 1.3558179483314, 'Nm': 1.0, 'N-m': 1.0, 'Nmm': 1e-3, 'N-mm': 1e-3,
    'kg-cm': 0.0980665, 'kN-m': 1e3, 'kNm': 1e3,
}  # fmt: skip


@dataclass(frozen=True)
class Threshold:
    """A monitor condition: counts of an axis (0 to 5 for Fx to Tz) above or below a limit; codes as in the box."""

    axis: int
    above: bool
    counts: int

    def met(self, counts: tuple[int, ...]) -> bool:
        """Whether these six counts fulfil it."""
        value = counts[self.axis]
        return value > self.counts if self.above else value < self.counts


@dataclass(frozen=True)
class NetFtConfig:
    """The settings; the defaults are the factory settings of a Mini40 SI-40-2, with unit strings as observed."""

    name: str = 'ATI Net F/T'
    force_unit: str = 'N'
    torque_unit: str = 'Nm'
    counts_per_force: int = 1_000_000
    counts_per_torque: int = 1_000_000
    ranges: tuple[float, ...] = (40.0, 40.0, 120.0, 2.0, 2.0, 2.0)
    divider: int = 7
    rdt_enabled: bool = True
    axia: bool = False
    monitoring: bool = False
    thresholds: tuple[Threshold, ...] = ()

    @property
    def rate_hz(self) -> int:
        """RDT output rate as the box reports it."""
        return round(INTERNAL_RATE_HZ / self.divider)

    def counts_per_si(self) -> tuple[float, ...]:
        """Counts per N (three times) and per N·m (three times)."""
        force = self.counts_per_force / FORCE_UNIT_N[self.force_unit]
        torque = self.counts_per_torque / TORQUE_UNIT_NM[self.torque_unit]
        return (force, force, force, torque, torque, torque)

    def full_scale_counts(self) -> tuple[float, ...]:
        """Counts at the ends of the ranges."""
        return tuple(
            limit * (self.counts_per_force if axis < 3 else self.counts_per_torque)
            for axis, limit in enumerate(self.ranges)
        )


def divider_for(rate_hz: int) -> int:
    """Divider of 7000 Hz for a rate, which the box rounds up: 150 gives 46 (152 Hz), 99 gives 70."""
    return max(1, INTERNAL_RATE_HZ // max(1, min(rate_hz, INTERNAL_RATE_HZ)))


def xml(config: NetFtConfig, status: int, counts: tuple[int, ...], bias: tuple[int, ...]) -> bytes:
    """The page ``/netftapi2.xml``."""
    fields = [
        ('runstat', f'{status:08x}'),
        ('runft', _list(counts)),
        ('runrate', str(INTERNAL_RATE_HZ)),
        *_active(config, bias),
        *_communication(config),
        ('mfgdigver', '2.2.59'),
    ]
    body = ''.join(f'<{name}>{value}</{name}>\n' for name, value in fields)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<netft>\n{body}</netft>\n'.encode('ascii')


def _active(config: NetFtConfig, bias: tuple[int, ...]) -> list[tuple[str, str]]:
    return [
        ('prodname', config.name),
        ('setcfgsel', '0'),
        ('setuserfilter', '0'),
        ('setbias', _list(tuple(max(-32768, min(32767, value >> 8)) for value in bias))),
        ('cfgnam', 'Configuration 1'),
        ('cfgcalsel', '0'),
        ('cfgcalsn', 'FT00000'),
        ('scfgfu', config.force_unit),
        ('scfgtu', config.torque_unit),
        ('cfgcpf', str(config.counts_per_force)),
        ('cfgcpt', str(config.counts_per_torque)),
        ('cfgmr', ';'.join(f'{limit:g}' for limit in config.ranges)),
        ('cfgtfx', '0;0;0;0;0;0'),
        ('scfgtdu', 'mm'),
        ('scfgtau', 'degrees'),
    ]


def _communication(config: NetFtConfig) -> list[tuple[str, str]]:
    return [
        ('comrdte', 'Enabled' if config.rdt_enabled else 'Disabled'),
        (_rate_field(config), str(config.rate_hz)),
    ]


def _rate_field(config: NetFtConfig) -> str:
    return 'commrdtrate' if config.axia else 'comrdtrate'


def _list(values: tuple[int, ...]) -> str:
    return ';'.join(map(str, values))


def changed(config: NetFtConfig, page: str, query: str) -> NetFtConfig | None:
    """The settings after a request for another rate, which is all that a driver changes; None: no such request."""
    asked = urllib.parse.parse_qs(query)
    if page != '/comm.cgi' or asked.keys() != {_rate_field(config)}:
        return None
    try:
        return dataclasses.replace(config, divider=divider_for(int(asked[_rate_field(config)][-1])))
    except ValueError:
        return None
