"""A bag as a table, without this package: rosbags reads it, because a bag carries the definitions of its messages.

    pip install rosbags pandas
    python examples/bag_with_pandas.py press1          prints the table and writes press1.csv

One row a force message: stamp of the image, total force, the largest contact, status, and the bins as f0 to f80, row by
row. With ROS 2 the same bag plays with `ros2 bag play press1`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

TOPIC = '/force_distribution'


def rows(bag: Path, topic: str = TOPIC) -> Iterator[dict[str, Any]]:
    """What each message says, in SI: N, m; positive into the gel. NaN: not known, or no contact."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        for connection, _, data in reader.messages(wanted):
            force: Any = reader.deserialize(data, connection.msgtype)
            stamp = force.header.stamp
            yield {
                'stamp_ns': stamp.sec * 1_000_000_000 + stamp.nanosec,
                'total_n': force.total,
                'total_sigma_n': force.total_sigma,
                'x_m': force.contact.x,
                'y_m': force.contact.y,
                'status': force.status,  # 0 ok, 1 degraded, 2 invalid
                'reasons': force.reasons,
                'model_id': force.provenance.model_id,
                **{f'f{bin_}': newtons for bin_, newtons in enumerate(force.normal_force)},
            }


def main() -> int:
    """Make the table, print its head, and write it. Returns the exit status."""
    import pandas

    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    bag = Path(sys.argv[1])
    table = pandas.DataFrame(rows(bag))
    if table.empty:
        print(f'{bag} holds no message of {TOPIC}', file=sys.stderr)
        return 1
    table.index = pandas.to_datetime(table['stamp_ns'])
    print(table[['total_n', 'x_m', 'y_m', 'status']].describe())
    print(
        f'{len(table)} forces, {(table["status"] == 0).mean():.1%} of them ok, at most {table["total_n"].max():.3f} N'
    )
    table.to_csv(f'{bag.resolve().stem}.csv', index=False)
    return 0


if __name__ == '__main__':
    sys.exit(main())
