"""What a run of a plan may do and what it asks for; a block of parameters for each concern."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tactile_nodes.params import parameter

SHORTEST_TOOL_MM = 10.0  # a tool without length would allow no torque at all


@dataclass(frozen=True)
class LimitSettings:
    """When everything stops. Each is looked at for every sample, or every 10 ms where silence is the sign."""

    force_n: float = parameter(3.0, 'a greater change of the force since the tare puts a press aside [N]', minimum=0.05)
    bearable_n: float = parameter(5.0, 'what gel, tip and sensor bear; beyond, a person has to look [N]', minimum=0.05)
    stiffness_n_mm: float = parameter(2.0, 'steepest rise of the force with depth [N/mm]', minimum=0.01)
    stop_ms: float = parameter(75.0, 'from a force at the sensor to the machine braking, at worst', minimum=1.0)
    brake_mm_s2: float = parameter(200.0, 'slowest deceleration of z (Grbl: $122) [mm/s²]', minimum=1.0)
    least_share: float = parameter(
        0.5,
        'of the force that the surface gave at a depth: less on the way down is a fault; 0.0: any',
        minimum=0.0,
        maximum=1.0,
    )
    torque_nm: float = parameter(0.0, 'likewise of the torque [N m]; 0.0: force_n at the end of the tool', minimum=0.0)
    force_rate_n_s: float = parameter(40.0, 'fastest rise of the force over rate_ms [N/s]', minimum=0.1)
    rate_ms: float = parameter(40.0, 'over which the rise of the force is taken', minimum=1.0)
    depth_mm: float = parameter(2.2, 'no press of a plan, and no search, goes deeper', minimum=0.0, maximum=10.0)
    force_silence_ms: float = parameter(50.0, 'newest force sample older than this (or three periods)', minimum=5.0)
    camera_silence_ms: float = parameter(250.0, 'without an image for so long', minimum=20.0)
    recover_s: float = parameter(30.0, 'how long a lost sensor or camera may take to come back', minimum=0.0)
    steady_again_s: float = parameter(2.0, 'how long it must be well again before the run goes on', minimum=0.0)
    rejects_in_a_row: int = parameter(
        5, 'so many rejected presses in a row, or silences before anything else is done, end the run', minimum=1
    )
    attempts: int = parameter(3, 'so often a press is tried before it is left out', minimum=1)
    hours: float = parameter(24.0, 'the run ends after so many hours', minimum=0.0)


@dataclass(frozen=True)
class MotionSettings:
    """How the tip goes. Every motion is made of short jogs that end by themselves."""

    travel_mm_min: float = parameter(1200.0, 'feed sideways and up, at the safe height', minimum=1.0)
    approach_mm_min: float = parameter(300.0, 'feed down to standoff_mm above the surface', minimum=1.0)
    press_mm_min: float = parameter(60.0, 'feed into the gel', minimum=1.0)
    standoff_mm: float = parameter(0.5, 'height above the surface at which the tip slows down', minimum=0.0)
    jog_s: float = parameter(0.25, 'longest jog: so long the machine goes on by itself at most, twice', minimum=0.02)


@dataclass(frozen=True)
class PressSettings:
    """How a press is made and when it counts."""

    tare_s: float = parameter(0.5, 'unloaded samples that a tare is the mean of', minimum=0.05)
    unloaded_n: float = parameter(0.05, 'a force that differs less from the tare is none', minimum=0.001)
    drift_n: float = parameter(1.0, 'greatest change of the tare since the start of the run', minimum=0.01)
    contact_n: float = parameter(0.01, 'a press that gives less force has not met the gel', minimum=0.0)
    steady_s: float = parameter(0.2, 'force and image must be steady for so long', minimum=0.02)
    steady_n_s: float = parameter(0.1, 'greatest |dF/dt| that is steady, beyond what noise makes of it', minimum=0.001)
    steady_grey: float = parameter(0.5, 'greatest image change that is steady, beyond noise [grey levels]', minimum=0.0)
    settle_s: float = parameter(5.0, 'a press that is not steady by then is rejected', minimum=0.1)
    shows_n: float = parameter(0.2, 'such a force must show in the images; 0.0: none must [N]', minimum=0.0)
    frames: int = parameter(5, 'images to record', minimum=1)
    rest_frames: int = parameter(1, 'images of the untouched gel to record before each press', minimum=0)
    window_s: float = parameter(0.1, 'force is recorded for so long at least', minimum=0.01)
    depth_error_mm: float = parameter(0.03, 'greatest error of the depth that the machine reports', minimum=0.001)
    indenter: str = parameter('sphere 1.2 mm', 'shape and size of the tip; empty or simulated: that of world')


@dataclass(frozen=True)
class SurfaceSettings:
    """Where the gel is, and how its surface is found."""

    gel_x_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    gel_y_mm: float = parameter(-60.0, "the gel's centre in machine coordinates")
    top_mm: float = parameter(-29.0, 'height from which to feel for the surface: surely above it')
    bottom_mm: float = parameter(-31.5, 'height at which to give up: the surface is surely above it')
    reach_mm: float = parameter(10.0, 'probed are the corners of a square: so far from the centre', minimum=0.5)
    corners: int = parameter(4, 'how many of them', minimum=3, maximum=4)
    step_mm: float = parameter(0.1, 'step of the first search', minimum=0.005, maximum=0.2)
    fine_step_mm: float = parameter(0.05, 'step of the repeated search', minimum=0.005, maximum=0.1)
    feed_mm_min: float = parameter(30.0, 'feed of these steps', minimum=1.0, maximum=60.0)
    repeats: int = parameter(3, 'repeated searches at each corner', minimum=1)
    dwell_s: float = parameter(0.1, 'force is averaged for so long after each step', minimum=0.01)
    least_n: float = parameter(0.02, 'a touch is five sigma and this', minimum=0.001)
    beyond: int = parameter(5, 'steps to go on after the touch, for the loading line', minimum=2)
    spread_mm: float = parameter(0.03, 'greatest difference between repeated searches', minimum=0.001)
    flat_mm: float = parameter(0.05, 'greatest distance of a corner from the plane through all', minimum=0.001)
    tilt: float = parameter(0.05, 'greatest slope of the surface, mm per mm', minimum=0.0)


@dataclass(frozen=True)
class AnchorSettings:
    """A place that is pressed again and again, to see whether an axis sticks or loses steps."""

    every: int = parameter(50, 'presses between two anchors; 0: none, and lost steps go unnoticed', minimum=0)
    x_mm: float = parameter(0.0, "on the gel's surface, from its centre")
    y_mm: float = parameter(0.0, "on the gel's surface, from its centre")
    depth_mm: float = parameter(1.0, 'depth of its presses', minimum=0.1)
    step_mm: float = parameter(0.5, 'how far beside it is pressed at the start', minimum=0.1, maximum=2.0)
    shift_mm: float = parameter(0.15, 'so far beside the first one the place counts as lost', minimum=0.01)


@dataclass(frozen=True)
class MountingSettings:
    """How the force/torque sensor is screwed to the machine."""

    upside_down: bool = parameter(False, "whether its z points down to the tool, as an ATI's does")
    turn_deg: float = parameter(0.0, "from the machine's x to the sensor's, about the machine's z", maximum=360.0)
    tool_mm: float = parameter(60.0, "from the tip up to the sensor's origin", minimum=0.0)


@dataclass(frozen=True)
class SyncSettings:
    """How the digital line is switched apart from presses, so that other recorders' clocks can be fitted."""

    pulses: int = parameter(6, 'pulses of the irregular pattern at start and end of a run; 0: none', minimum=0)
    every: int = parameter(200, 'presses after which it is switched again; 0: at start and end alone', minimum=0)


@dataclass(frozen=True)
class CollectionSettings:
    """All of it."""

    limits: LimitSettings = field(default_factory=LimitSettings)
    motion: MotionSettings = field(default_factory=MotionSettings)
    press: PressSettings = field(default_factory=PressSettings)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    anchor: AnchorSettings = field(default_factory=AnchorSettings)
    mounting: MountingSettings = field(default_factory=MountingSettings)
    sync: SyncSettings = field(default_factory=SyncSettings)
    reference_every: int = parameter(100, 'presses after which a new rest image is taken', minimum=1)
    reference_frames: int = parameter(16, 'images averaged for it', minimum=1)

    @property
    def watched(self) -> LimitSettings:
        """The limits, with one of the torque: where none is set, that of the greatest force across the end of the tool.

        3 N and 60 mm give 0.18 N m.
        """
        if self.limits.torque_nm:
            return self.limits
        lever_mm = max(self.mounting.tool_mm, SHORTEST_TOOL_MM)
        return replace(self.limits, torque_nm=self.limits.force_n * lever_mm / 1000)
