"""Whether the configuration of a Grbl controller is safe for a sensor. Settings are read, never written."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from tactile_nodes.drivers.cnc.contract import (
    NO_HARD_LIMITS,
    NO_HOMING,
    NO_SOFT_LIMITS,
    CncSettings,
    Envelope,
    Identity,
    Place,
)
from tactile_nodes.errors import DeviceFaultError

KEEP_MOTORS_ON = 255
GUARDS = ((20, 'soft limits', NO_SOFT_LIMITS), (21, 'hard limits', NO_HARD_LIMITS), (22, 'homing', NO_HOMING))
FLUIDNC_GUARDS = {20: 'soft_limits', 21: 'motor0/hard_limits', 22: 'homing/cycle'}
"""Settings of FluidNC that correspond to `GUARDS`, below ``$/axes/x/`` (its Axis.cpp, Motor.cpp, Homing.h)."""
FLUIDNC_IDLE = '$/stepping/idle_ms'


def identity_of(lines: list[str], banner: str) -> Identity:
    """The firmware from its answer to ``$I``, because banners can be changed."""
    fields = [line.strip('[]') for line in lines]
    version = next((field[4:].rstrip(':') for field in fields if field.startswith('VER:')), '')
    text = ' '.join([*fields, banner])
    firmware = 'grblHAL' if 'FIRMWARE:grblHAL' in text else 'FluidNC' if 'FluidNC' in text else 'Grbl'
    options = tuple(field for field in fields if not field.startswith('VER:'))
    return Identity(firmware, version, options)


def travel(identity: Identity, memory: Mapping[int, str]) -> Envelope | None:
    """The machine's own workspace, from minus the travel to 0; None if its settings do not contain it (FluidNC).

    grblHAL ($22 bit 3) and Grbl (a compile option, a Z among its options) may count up from the switch of an axis that
    homes to its lower end ($23).
    """
    if identity.firmware == 'FluidNC' or not {130, 131, 132} <= memory.keys():
        return None
    counts_up = int(_number(memory, 23)) if _zero_at_switch(identity, memory) else 0
    sizes = [_number(memory, number) for number in (130, 131, 132)]
    up = [bool(counts_up & 1 << axis) for axis in range(3)]
    low = [0.0 if each else -size for each, size in zip(up, sizes, strict=True)]
    high = [size if each else 0.0 for each, size in zip(up, sizes, strict=True)]
    return Envelope((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _zero_at_switch(identity: Identity, memory: Mapping[int, str]) -> bool:
    if identity.firmware == 'grblHAL':
        return bool(int(_number(memory, 22)) & 8)
    letters = next((option[4:].partition(',')[0] for option in identity.options if option.startswith('OPT:')), '')
    return 'Z' in letters


def of_fluidnc(read: Callable[[str], str]) -> dict[int, str]:
    """The safety settings of a FluidNC as numbered settings.

    Its own ``$20`` is for the x axis only and its ``$21`` for any motor, so every axis is queried.

    Args:
        read: the value of a setting such as ``$/axes/z/soft_limits``; empty if it has none.
    """
    found = {1: read(FLUIDNC_IDLE)}
    for number, key in FLUIDNC_GUARDS.items():
        axes = [_is_set(read(f'$/axes/{axis}/{key}')) for axis in 'xyz']
        found[number] = str(int(all(axes)))
    return found


def _is_set(value: str) -> bool:
    """Whether a switch is on, or a homing cycle is set: 0 means none, and with -1 the axis does not home."""
    return value == 'true' or (value.isdigit() and int(value) > 0)


def check(name: str, identity: Identity, memory: Mapping[int, str], settings: CncSettings) -> list[str]:
    """Refuse dangerous settings; returns warnings for a person.

    Raises:
        DeviceFaultError: laser mode; no soft limits, no hard limits or no homing, unless the risk is accepted.
    """
    if _number(memory, 32):
        raise DeviceFaultError(
            f'{name} is in laser or lathe mode ($32={memory[32]}), in which it moves differently from a mill; set $32=0'
        )
    warnings = []
    for number, guard, risk in GUARDS:
        if not _is_on(memory, number):
            _accepted(name, _where(identity, number), guard, risk, settings)
            warnings.append(f'{guard} off (${number}={memory.get(number, "?")})')
    if memory.get(1, '') != str(KEEP_MOTORS_ON):
        idle = FLUIDNC_IDLE if identity.firmware == 'FluidNC' else '$1'
        warnings.append(
            f'{idle}={memory.get(1, "?")}: motors are released at rest and the position may be lost; set {idle}=255'
        )
    if _number(memory, 13):
        warnings.append('reports in inches ($13=1); they are converted')
    return warnings


def _is_on(memory: Mapping[int, str], number: int) -> bool:
    """Whether the lowest bit is set. On grblHAL, $22 has more bits, which have no effect without it."""
    return bool(int(_number(memory, number)) & 1)


def _where(identity: Identity, number: int) -> str:
    if identity.firmware == 'FluidNC':
        return f'{FLUIDNC_GUARDS[number]} of every axis in its config.yaml'
    return f'${number}=0'


def _accepted(name: str, where: str, guard: str, risk: str, settings: CncSettings) -> None:
    if risk not in settings.accept:
        raise DeviceFaultError(
            f"{name} has {guard} switched off ({where}); switch it on, or add '{risk}' to the setting accept"
        )


def _number(memory: Mapping[int, str], number: int) -> float:
    try:
        return float(memory.get(number, '0'))
    except ValueError:
        return 0.0


def acceleration_of(memory: Mapping[int, str], otherwise: float) -> float:
    """The smallest acceleration of any axis in mm/s²."""
    found = [_number(memory, number) for number in (120, 121, 122)]
    return min((value for value in found if value > 0), default=otherwise)


def speeds_of(memory: Mapping[int, str]) -> Place:
    """The largest speed of each axis in mm/s; infinite where it is unknown."""
    x, y, z = (_number(memory, number) / 60 or math.inf for number in (110, 111, 112))
    return (x, y, z)


def without_homing(memory: Mapping[int, str], settings: CncSettings) -> bool:
    """Whether this machine cannot home, and that is accepted."""
    return NO_HOMING in settings.accept and not _is_on(memory, 22)
