"""Limits and requirements of a run; a block of parameters for each concern."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tactile_nodes.collection.readings import KEPT_FRAMES, KEPT_S
from tactile_nodes.params import parameter

SHORTEST_TOOL_MM = 10.0  # a tool without length would allow no torque at all


@dataclass(frozen=True)
class LimitSettings:
    """When everything stops. Limits are checked for every sample, silence every 10 ms."""

    force_n: float = parameter(3.0, 'a larger change of the force since the tare sets a press aside [N]', minimum=0.05)
    bearable_n: float = parameter(
        5.0, 'largest force that gel, tip and sensor bear; above it, a person must check [N]', minimum=0.05
    )
    stiffness_n_mm: float = parameter(2.0, 'largest stiffness, the rise of the force with depth [N/mm]', minimum=0.01)
    stop_ms: float = parameter(
        75.0, 'longest time from a force at the sensor to the braking of the machine', minimum=1.0
    )
    least_share: float = parameter(
        0.5,
        'fraction of the force expected from the surface search; less on the way down is a fault; 0.0: off',
        minimum=0.0,
        maximum=1.0,
    )
    torque_nm: float = parameter(
        0.0, 'largest change of the torque [N m]; 0.0: force_n at the end of the tool', minimum=0.0
    )
    force_rate_n_s: float = parameter(40.0, 'largest rise of the force over rate_ms [N/s]', minimum=0.1)
    rate_ms: float = parameter(40.0, 'time over which the rise of the force is measured', minimum=1.0)
    depth_mm: float = parameter(2.2, 'largest depth of a press or search', minimum=0.0, maximum=10.0)
    force_silence_ms: float = parameter(50.0, 'largest age of the newest force sample (or three periods)', minimum=5.0)
    camera_silence_ms: float = parameter(250.0, 'longest time without an image', minimum=20.0)
    recover_s: float = parameter(30.0, 'how long to wait for a lost sensor, camera or machine', minimum=0.0)
    steady_again_s: float = parameter(2.0, 'how long it must work again before the run continues', minimum=0.0)
    rejects_in_a_row: int = parameter(
        5, 'number of rejected presses in a row, or of consecutive silences, that ends the run', minimum=1
    )
    attempts: int = parameter(3, 'number of attempts before a press is left out', minimum=1)
    hours: float = parameter(24.0, 'the run ends after this many hours, not counting waits for a person', minimum=0.0)


@dataclass(frozen=True)
class MotionSettings:
    """Motion of the tip. Every motion consists of short jogs that end by themselves."""

    travel_mm_min: float = parameter(1200.0, 'feed sideways and up, at the safe height', minimum=1.0)
    approach_mm_min: float = parameter(300.0, 'feed down to standoff_mm above the surface', minimum=1.0)
    press_mm_min: float = parameter(60.0, 'feed into the gel', minimum=1.0)
    standoff_mm: float = parameter(0.5, 'height above the surface at which the tip slows down', minimum=0.0)
    jog_s: float = parameter(
        0.25, 'longest jog; the machine continues by itself for at most twice this time', minimum=0.02
    )


@dataclass(frozen=True)
class PressSettings:
    """How a press is made, and when it counts."""

    tare_s: float = parameter(0.5, 'time over which a tare is averaged, unloaded', minimum=0.05)
    unloaded_n: float = parameter(0.05, 'a force that differs less from the tare counts as zero', minimum=0.001)
    drift_n: float = parameter(1.0, 'largest change of the tare since the start of the run', minimum=0.01)
    contact_n: float = parameter(0.01, 'a press with a smaller force has not met the gel', minimum=0.0)
    steady_s: float = parameter(0.2, 'how long force and image must be steady', minimum=0.02)
    steady_n_s: float = parameter(0.1, 'largest |dF/dt| that counts as steady, beyond noise', minimum=0.001)
    steady_grey: float = parameter(
        0.5, 'largest image change that counts as steady, beyond noise [grey levels]', minimum=0.0
    )
    settle_s: float = parameter(5.0, 'a press that is not steady after this time is rejected', minimum=0.1)
    shows_n: float = parameter(0.2, 'force that must be visible in the images; 0.0: off [N]', minimum=0.0)
    frames: int = parameter(5, 'images to record', minimum=1, maximum=KEPT_FRAMES)
    rest_frames: int = parameter(
        1, 'images of the untouched gel to record before each press', minimum=0, maximum=KEPT_FRAMES
    )
    window_s: float = parameter(0.1, 'shortest time for which the force is recorded', minimum=0.01, maximum=KEPT_S / 2)
    depth_error_mm: float = parameter(0.03, 'largest error of the depth reported by the machine', minimum=0.001)
    indenter: str = parameter('sphere 1.2 mm', 'shape and size of the tip; empty or simulated: that of world')


@dataclass(frozen=True)
class SurfaceSettings:
    """Position of the gel, and the search for its surface."""

    gel_x_mm: float = parameter(-60.0, 'centre of the gel in machine coordinates')
    gel_y_mm: float = parameter(-60.0, 'centre of the gel in machine coordinates')
    top_mm: float = parameter(-29.0, 'height from which the surface search starts: certainly above the surface')
    bottom_mm: float = parameter(-31.5, 'height at which the search gives up: the surface is certainly above it')
    reach_mm: float = parameter(
        10.0, 'distance of the probed corners of a square from its centre, in x and y', minimum=0.5
    )
    corners: int = parameter(4, 'number of corners', minimum=3, maximum=4)
    step_mm: float = parameter(0.1, 'step of the first search', minimum=0.005, maximum=0.2)
    fine_step_mm: float = parameter(0.05, 'step of the repeated search', minimum=0.005, maximum=0.1)
    feed_mm_min: float = parameter(30.0, 'feed of these steps', minimum=1.0, maximum=60.0)
    repeats: int = parameter(3, 'repeated searches at each corner', minimum=1)
    dwell_s: float = parameter(0.1, 'time over which the force is averaged after each step', minimum=0.01)
    least_n: float = parameter(0.02, 'contact threshold: five sigma plus this', minimum=0.001)
    beyond: int = parameter(5, 'steps after contact, for the loading line', minimum=2)
    spread_mm: float = parameter(0.03, 'largest difference between repeated searches', minimum=0.001)
    flat_mm: float = parameter(0.05, 'largest distance of a corner from the plane through all corners', minimum=0.001)
    tilt: float = parameter(0.05, 'largest slope of the surface, mm per mm', minimum=0.0)


@dataclass(frozen=True)
class AnchorSettings:
    """A place that is pressed repeatedly, to detect an axis that sticks or loses steps."""

    every: int = parameter(50, 'presses between two anchors; 0: no anchors, so lost steps go unnoticed', minimum=0)
    x_mm: float = parameter(0.0, "position on the gel's surface, from its centre")
    y_mm: float = parameter(0.0, "position on the gel's surface, from its centre")
    depth_mm: float = parameter(1.0, 'depth of its presses', minimum=0.1)
    step_mm: float = parameter(0.5, 'displacement of the presses beside it at the start', minimum=0.1, maximum=2.0)
    shift_mm: float = parameter(
        0.15, 'displacement from the first anchor at which the position counts as lost', minimum=0.01
    )


@dataclass(frozen=True)
class MountingSettings:
    """Mounting of the force/torque sensor on the machine."""

    upside_down: bool = parameter(False, "whether the sensor's z axis points down to the tool, as for an ATI")
    turn_deg: float = parameter(
        0.0, "angle from the machine's x axis to the sensor's, about the machine's z axis", maximum=360.0
    )
    tool_mm: float = parameter(60.0, "distance from the tip up to the sensor's origin", minimum=0.0)


@dataclass(frozen=True)
class SyncSettings:
    """Switching of the digital line apart from presses, so that clocks of other recorders can be fitted."""

    pulses: int = parameter(6, 'pulses of the irregular pattern at start and end of a run; 0: none', minimum=0)
    every: int = parameter(200, 'presses between two patterns; 0: only at start and end', minimum=0)


@dataclass(frozen=True)
class CollectionSettings:
    """All settings."""

    limits: LimitSettings = field(default_factory=LimitSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    press: PressSettings = field(default_factory=PressSettings)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    anchor: AnchorSettings = field(default_factory=AnchorSettings)
    mounting: MountingSettings = field(default_factory=MountingSettings)
    sync: SyncSettings = field(default_factory=SyncSettings)
    reference_every: int = parameter(100, 'presses between two rest images', minimum=1)
    reference_frames: int = parameter(16, 'images averaged for a rest image', minimum=1, maximum=KEPT_FRAMES)

    @property
    def watched(self) -> LimitSettings:
        """The limits with a torque limit; if none is set, it is the torque of `force_n` at the end of the tool.

        3 N and 60 mm give 0.18 N m.
        """
        if self.limits.torque_nm:
            return self.limits
        lever_mm = max(self.mounting.tool_mm, SHORTEST_TOOL_MM)
        return replace(self.limits, torque_nm=self.limits.force_n * lever_mm / 1000)
