"""From a bag to a figure: force over time, what acts on the surface at one instant, the contacts, and the status.

Of a model that tells force_field the surface is drawn as a smooth map of the pressure with arrows of the shear and the
outlines of the contacts, else as the force on each bin.

    python examples/bag_to_figure.py press1                          press1.png, at the instant of the largest force
    python examples/bag_to_figure.py press1 -o touch.pdf --at 3.2    the map 3.2 s after the first force
    python examples/bag_to_figure.py robot --namespace /left         one of several sensors

It needs matplotlib (pip install 'tactile_nodes[train]'). How to read a bag without this package: bag_with_pandas.py.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_nodes.bag.reader import BagReader
from tactile_nodes.bus import topics
from tactile_nodes.bus.names import absolute_namespace
from tactile_nodes.errors import BagError, TactileError
from tactile_nodes.learning.figures import figure, save
from tactile_nodes.messages import stamp_ns, types
from tactile_nodes.viewing.net import net_of
from tactile_nodes.viewing.surface import Surface, over_half, surface_of

ARROWS = 18  # along each side at most
LEAST_ARROW = 0.06  # of the longest one: shorter ones would only be noise
COLOURS = {0: 'tab:green', 1: 'tab:orange', 2: 'tab:red'}
NAMES = {0: 'ok', 1: 'degraded', 2: 'invalid'}
REASONS = {
    value: name.removeprefix('REASON_').lower().replace('_', ' ')
    for name, value in vars(types.ForceDistribution).items()
    if name.startswith('REASON_')
}


@dataclass(frozen=True)
class Forces:
    """The forces of a bag. Times are seconds since the first stamp; places are mm in the frame of the surface."""

    time_s: np.ndarray  # (n,)
    total_n: np.ndarray  # (n,)
    sigma_n: np.ndarray  # (n,) NaN where the model does not know
    map_n: np.ndarray  # (n, rows, cols)
    status: np.ndarray  # (n,) 0 ok, 1 degraded, 2 invalid
    reasons: np.ndarray  # (n,) bits
    shear_n: np.ndarray  # (n,) net shear; NaN where the model does not look for it
    contacts: np.ndarray  # (m, 4) time in s, x and y in mm, force in N
    told: list[Any]  # (n) the messages
    extent_mm: tuple[float, float, float, float]  # left, right, bottom, top of the map as it is drawn
    start_ns: int


def main() -> int:
    """Read, draw, write. Returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument('bag', type=Path, help='a folder, a .mcap file or a .db3 file')
    parser.add_argument('-o', '--output', type=Path, help='picture to write (default: BAG.png, here)')
    parser.add_argument('--at', type=float, metavar='S', help='instant of the map (default: of the largest force)')
    parser.add_argument('--namespace', default='/', help='of the sensor (default: /)')
    arguments = parser.parse_args()
    try:
        output = arguments.output or Path(f'{arguments.bag.resolve().stem}.png')
        namespace = absolute_namespace(arguments.namespace)
        forces, truth = read(arguments.bag, namespace)
        at = instant(forces, arguments.at)
        surface = read_surface(arguments.bag, namespace, stamp_ns(forces.told[at].header.stamp))
        save(draw(forces, truth, arguments.at, surface), output)
    except TactileError as error:
        print(error, file=sys.stderr)
        return 1
    print(f'wrote {output}')
    return 0


def read(path: Path, namespace: str = '/') -> tuple[Forces, np.ndarray]:
    """The forces of a bag, and what a simulator pressed with: (k, 2) of time in s and force in N, or none.

    Raises:
        BagError: no bag, or none of the forces in it.
    """
    force_topic, true_topic = (
        f'{namespace.rstrip("/")}/{topic.name}' for topic in (topics.FORCE_DISTRIBUTION, topics.TRUE_FORCE)
    )
    with BagReader(path) as bag:
        told = [bag.decode(message) for message in bag.messages([force_topic])] if force_topic in bag.topics else []
        true = [bag.decode(message) for message in bag.messages([true_topic])] if true_topic in bag.topics else []
        if not told:
            raise BagError(f'{path} holds no message of {force_topic}; see: tactile bag info {path}')
        for problem in bag.problems:
            print(problem, file=sys.stderr)
    forces = gather(told)
    truth = [((stamp_ns(each.header.stamp) - forces.start_ns) / 1e9, each.total) for each in true]
    return forces, np.array(truth).reshape(-1, 2)


def read_surface(path: Path, namespace: str, at_ns: int) -> Surface | None:
    """The force field of the frame with this stamp; None where the bag holds none."""
    topic = f'{namespace.rstrip("/")}/{topics.FORCE_FIELD.name}'
    with BagReader(path) as bag:
        for message in bag.messages([topic]) if topic in bag.topics else ():
            field = bag.decode(message)
            if stamp_ns(field.header.stamp) == at_ns:
                return surface_of(field)
    return None


def gather(told: list[Any]) -> Forces:
    """Messages as arrays."""
    stamps_ns = np.array([stamp_ns(force.header.stamp) for force in told])
    time_s = (stamps_ns - stamps_ns[0]) / 1e9
    first = told[0]
    left, top = first.origin.x * 1e3, first.origin.y * 1e3
    right, bottom = left + first.cols * first.bin_width * 1e3, top + first.rows * first.bin_height * 1e3
    contacts = [
        (at_s, contact.position.x * 1e3, contact.position.y * 1e3, contact.force)
        for at_s, force in zip(time_s, told, strict=True)
        for contact in force.contacts
    ]
    return Forces(
        time_s=time_s,
        total_n=np.array([force.total for force in told]),
        sigma_n=np.array([force.total_sigma for force in told]),
        map_n=np.stack([np.reshape(force.normal_force, (first.rows, first.cols)) for force in told]),
        status=np.array([force.status for force in told]),
        reasons=np.array([force.reasons for force in told]),
        shear_n=np.array([net_of(force).shear_n for force in told]),
        contacts=np.array(contacts).reshape(-1, 4),
        told=told,
        extent_mm=(left, right, bottom, top),
        start_ns=int(stamps_ns[0]),
    )


def instant(forces: Forces, at_s: float | None) -> int:
    """The frame that is drawn: that of the largest force, or the one at a time. Raises BagError: none is near it."""
    if at_s is not None and not -1.0 <= at_s <= forces.time_s[-1] + 1.0:
        raise BagError(f'there is no force at {at_s:g} s: those of the bag span 0 to {forces.time_s[-1]:.1f} s')
    usable = np.where(forces.status == types.ForceDistribution.STATUS_INVALID, -np.inf, forces.total_n)
    return int(np.argmax(usable)) if at_s is None else int(np.argmin(np.abs(forces.time_s - at_s)))


def draw(forces: Forces, truth: np.ndarray, at_s: float | None = None, surface: Surface | None = None) -> Any:
    """The figure; `surface` is the force field of the instant, where there is one."""
    at = instant(forces, at_s)
    made = figure(10.0, 7.5)
    grid = made.add_gridspec(3, 2, height_ratios=(4, 5, 1))
    draw_total(made.add_subplot(grid[0, :]), forces, truth, at)
    axes = made.add_subplot(grid[1, 0])
    draw_map(axes, forces, at) if surface is None else draw_surface(axes, forces, at, surface)
    draw_contacts(made.add_subplot(grid[1, 1]), forces)
    draw_status(made.add_subplot(grid[2, :]), forces)
    return made


def draw_total(axes: Any, forces: Forces, truth: np.ndarray, at: int) -> None:
    """Total force with one standard deviation, beside the true one where there is one, and net shear where known."""
    if len(truth):
        axes.plot(truth[:, 0], truth[:, 1], color='0.6', linewidth=3, label='true')
    axes.plot(forces.time_s, forces.total_n, color='tab:blue', linewidth=1, label='measured')
    low, high = forces.total_n - forces.sigma_n, forces.total_n + forces.sigma_n
    axes.fill_between(forces.time_s, low, high, color='tab:blue', alpha=0.3, linewidth=0)
    if np.isfinite(forces.shear_n).any():
        axes.plot(forces.time_s, forces.shear_n, color='tab:orange', linewidth=1, label='net shear')
    axes.axvline(forces.time_s[at], color='black', linewidth=0.8, linestyle=':')
    axes.set(xlabel='time [s]', ylabel='force [N]', title='Total normal force, one standard deviation')
    axes.legend(loc='upper right')


def draw_map(axes: Any, forces: Forces, at: int) -> None:
    """Force on each bin, x to the right and y downwards as in the image, with rings at the contacts."""
    image = axes.imshow(forces.map_n[at], extent=forces.extent_mm, cmap='viridis', vmin=0.0)
    axes.figure.colorbar(image, ax=axes, label='N on the bin')
    here = forces.contacts[forces.contacts[:, 0] == forces.time_s[at]]
    axes.scatter(here[:, 1], here[:, 2], s=120, facecolors='none', edgecolors='tab:red')
    axes.set(xlabel='x [mm]', ylabel='y [mm]', title=headline(forces, at))


def draw_surface(axes: Any, forces: Forces, at: int, surface: Surface) -> None:
    """Pressure as a smooth map, shear as arrows, and where each contact carries half of its highest pressure."""
    x_mm, y_mm = surface.centres_mm
    image = axes.imshow(
        surface.pressure_kpa, extent=forces.extent_mm, cmap='inferno', vmin=0.0, interpolation='bicubic'
    )
    axes.figure.colorbar(image, ax=axes, label='pressure [kPa]')
    shares = over_half(surface, forces.told[at].contacts)
    if shares.max() > 1:
        axes.contour(x_mm, y_mm, shares, [1.0], colors='#5be0ff', linewidths=1.0)
    draw_shear(axes, surface)
    axes.set(xlabel='x [mm]', ylabel='y [mm]', title=headline(forces, at))


def draw_shear(axes: Any, surface: Surface) -> None:
    """Arrows of means over blocks of cells, with how long which shear is."""
    size = math.ceil(max(surface.pressure_kpa.shape) / ARROWS)
    rows, cols = (count // size for count in surface.pressure_kpa.shape)
    blocks = surface.shear_kpa[: rows * size, : cols * size].reshape(rows, size, cols, size, 2).mean(axis=(1, 3))
    longest = float(np.hypot(*blocks.T).max())
    if not longest > 0:
        return
    x_mm, y_mm = (
        places[: count * size].reshape(count, size).mean(axis=1)
        for places, count in zip(surface.centres_mm, (cols, rows), strict=True)
    )
    shown = np.where(np.hypot(blocks[..., 0], blocks[..., 1])[..., None] < LEAST_ARROW * longest, np.nan, blocks)
    spacing = x_mm[1] - x_mm[0] if cols > 1 else surface.cell_mm[0]
    drawn = axes.quiver(
        x_mm, y_mm, shown[..., 0], shown[..., 1], color='white', edgecolor='black', linewidth=0.4, pivot='middle',
        angles='xy', scale_units='xy', scale=longest / (1.4 * spacing), width=0.008,
    )  # fmt: skip
    axes.quiverkey(
        drawn, 0.6, 0.06, longest, f'{longest:.2g} kPa shear', labelpos='E', color='white', labelcolor='white'
    )


def headline(forces: Forces, at: int) -> str:
    """What acts at the instant of the map."""
    shear = f', shear {forces.shear_n[at]:.3f} N' if math.isfinite(forces.shear_n[at]) else ''
    return f'{forces.total_n[at]:.3f} N{shear} at {forces.time_s[at]:.2f} s'


def draw_contacts(axes: Any, forces: Forces) -> None:
    """Where the contacts were, and how strong: the strongest on top."""
    left, right, bottom, top = forces.extent_mm
    _, x_mm, y_mm, force_n = forces.contacts[np.argsort(forces.contacts[:, 3])].T
    dots = axes.scatter(x_mm, y_mm, c=force_n, s=8, cmap='viridis', vmin=0.0)
    axes.figure.colorbar(dots, ax=axes, label='N of the contact')
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect='equal', xlabel='x [mm]', ylabel='y [mm]')
    axes.set_title(f'Contacts of {len(forces.time_s)} frames')


def draw_status(axes: Any, forces: Forces) -> None:
    """The status of each frame, and the reasons that were given. What is white was lost, or not recorded."""
    counts = []
    for status, colour in COLOURS.items():
        times = forces.time_s[forces.status == status]
        axes.vlines(times, 0.0, 1.0, color=colour, linewidth=1.5)
        counts.append(f'{len(times)} {NAMES[status]}')
    every = int(np.bitwise_or.reduce(forces.reasons))
    said = ', '.join(name for bit, name in REASONS.items() if every & bit) or 'none'
    axes.set(yticks=[], xlim=(forces.time_s[0], max(forces.time_s[-1], 1e-3)), xlabel='time [s]')
    axes.set_title(f'Status of each frame: {", ".join(counts)}; reasons: {said}', fontsize='medium')


if __name__ == '__main__':
    sys.exit(main())
