"""Differences between Grbl 1.1h and grblHAL, and the settings that both store."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_nodes.emulators.motion import Vector
from tactile_nodes.params import parameter

SETTINGS: dict[int, str] = {
    0: '10', 1: '255', 2: '0', 3: '0', 4: '0', 5: '0', 6: '0', 10: '1', 11: '0.010', 12: '0.002', 13: '0',
    20: '1', 21: '1', 22: '1', 23: '0', 24: '100.000', 25: '1500.000', 26: '250', 27: '1.000', 30: '1000',
    31: '0', 32: '0', 100: '400.000', 101: '400.000', 102: '400.000', 110: '2400.000', 111: '2400.000',
    112: '1200.000', 120: '200.000', 121: '200.000', 122: '200.000', 130: '120.000', 131: '120.000',
    132: '60.000',
}  # fmt: skip
"""A rig that is set up: limits and homing on, motors kept on, 400 steps/mm, the travel of the world."""


@dataclass(frozen=True)
class Dialect:
    """One firmware."""

    banner: str
    identity: tuple[str, ...]
    planner_blocks: int
    receive_bytes: int
    answers_in_critical_alarm: bool


GRBL = Dialect(
    banner="Grbl 1.1h ['$' for help]",
    identity=('[VER:1.1h.20190830:]', '[OPT:V,15,128]'),
    planner_blocks=15,
    receive_bytes=128,
    answers_in_critical_alarm=False,
)
GRBLHAL = Dialect(
    banner="GrblHAL 1.1f ['$' or '$HELP' for help]",
    identity=(
        '[VER:1.1f.20260817:]',
        '[OPT:VNML+,100,1024,3,0]',
        '[AXS:3:XYZ]',
        '[NEWOPT:ENUMS,RT+]',
        '[FIRMWARE:grblHAL]',
        '[SIGNALS:HSEP]',
    ),
    planner_blocks=100,
    receive_bytes=1024,
    answers_in_critical_alarm=True,
)
DIALECTS = {'grbl': GRBL, 'grblhal': GRBLHAL}


@dataclass(frozen=True)
class GrblSettings:
    """Which firmware, and its stored settings."""

    dialect: str = parameter('grbl', 'which firmware', choices=('grbl', 'grblhal'))
    baud: int = parameter(115200, 'bits per second', minimum=9600)
    changes: tuple[str, ...] = parameter((), "settings that differ, as '$13=1'")

    def memory(self) -> dict[int, str]:
        """The numbered settings."""
        memory = dict(SETTINGS)
        if self.dialect == 'grblhal':
            memory[10] = '3'
        for change in self.changes:
            number, value = change.removeprefix('$').split('=')
            memory[int(number)] = value
        return memory


def axes_of(memory: dict[int, str], first: int) -> Vector:
    """Three settings with successive numbers as a vector."""
    return (float(memory[first]), float(memory[first + 1]), float(memory[first + 2]))
