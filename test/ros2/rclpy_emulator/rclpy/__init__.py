"""An emulator of the part of rclpy that `tactile_nodes.bus.ros2.graph_bus` uses, in one process and without DDS.

Written from the behaviour of rclpy 7.1 (Jazzy), so that the bus can be tested where ROS 2 cannot be installed: names
and signatures, what publishers and subscriptions of which quality of service hear each other, keep last and transient
local, raw bytes, coroutines as service callbacks, the executor that must be woken, contexts. It stands in for nothing
when the package runs. What it cannot show is listed in docs/ros2.md.
"""

from __future__ import annotations

import sys
from typing import Any

from rclpy import generated
from rclpy.context import Context, get_default_context
from rclpy.signals import SignalHandlerOptions

EMULATED = True


def init(
    *,
    args: list[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> None:
    """As rclpy's; without `signal_handler_options`, the default context takes the signals."""
    chosen = get_default_context() if context is None else context
    if signal_handler_options is None:
        signal_handler_options = SignalHandlerOptions.ALL if context is None else SignalHandlerOptions.NO
    if signal_handler_options is not SignalHandlerOptions.NO:
        raise NotImplementedError('the emulator takes no signals')
    chosen.init(sys.argv if args is None else args, domain_id=domain_id)


generated.install()
__all__: list[Any] = ['Context', 'init']
