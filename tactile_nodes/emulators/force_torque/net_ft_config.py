"""Settings of an emulated ATI Net F/T box, and its ``netftapi2.xml``."""

from __future__ import annotations

from dataclasses import dataclass

INTERNAL_RATE_HZ = 7000
RANGES = (40.0, 40.0, 120.0, 2.0, 2.0, 2.0)
"""Of a Mini40 SI-40-2, in N and N·m."""


@dataclass(frozen=True)
class NetFtConfig:
    """The settings; the defaults are the factory settings of a Mini40 SI-40-2, with unit strings as observed."""

    name: str = 'ATI Net F/T'
    counts_per_force: int = 1_000_000
    counts_per_torque: int = 1_000_000
    divider: int = 7
    rdt_enabled: bool = True
    axia: bool = False

    @property
    def rate_hz(self) -> int:
        """RDT output rate as the box reports it."""
        return round(INTERNAL_RATE_HZ / self.divider)

    @property
    def rate_field(self) -> str:
        """Name of the field with the rate, which Axia sensors spell differently."""
        return 'commrdtrate' if self.axia else 'comrdtrate'

    @property
    def counts_per_si(self) -> tuple[int, ...]:
        """Counts per N (three times) and per N·m (three times)."""
        return (self.counts_per_force,) * 3 + (self.counts_per_torque,) * 3


def xml(config: NetFtConfig, status: int, counts: tuple[int, ...]) -> bytes:
    fields = [
        ('runstat', f'{status:08x}'),
        ('runft', ';'.join(map(str, counts))),
        ('runrate', str(INTERNAL_RATE_HZ)),
        ('prodname', config.name),
        ('setcfgsel', '0'),
        ('setuserfilter', '0'),
        ('setbias', '0;0;0;0;0;0'),
        ('cfgnam', 'Configuration 1'),
        ('cfgcalsel', '0'),
        ('cfgcalsn', 'FT00000'),
        ('scfgfu', 'N'),
        ('scfgtu', 'Nm'),
        ('cfgcpf', str(config.counts_per_force)),
        ('cfgcpt', str(config.counts_per_torque)),
        ('cfgmr', ';'.join(f'{limit:g}' for limit in RANGES)),
        ('cfgtfx', '0;0;0;0;0;0'),
        ('scfgtdu', 'mm'),
        ('scfgtau', 'degrees'),
        ('comrdte', 'Enabled' if config.rdt_enabled else 'Disabled'),
        (config.rate_field, str(config.rate_hz)),
        ('mfgdigver', '2.2.59'),
    ]
    body = ''.join(f'<{name}>{value}</{name}>\n' for name, value in fields)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<netft>\n{body}</netft>\n'.encode('ascii')
