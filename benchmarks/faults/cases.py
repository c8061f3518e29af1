"""The faults of the benchmark: what is done to a running collection, and for how long."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import dataclass, field

from tactile_nodes.params import Value

GOES_ON, ENDS = 'goes on by itself', 'ends; a person starts it again'
ASKS = 'waits for a person, who lets it go on'
FOR_EVER = 0.0


@dataclass(frozen=True)
class Case:
    """A fault.

    Attributes:
        name: name on the command line.
        text: name in the table.
        switch: parameters of the emulated rig, without ``faults.``.
        lasts_s: time until they are switched off again; `FOR_EVER`: only at the end of the launch.
        process: the process that gets the signal `number`: a program of the launch, or ``launch``.
        full_disk: whether the files of `process` can no longer grow.
        expect: the expected reaction of the run.
        sensor: the force/torque sensor of the rig.
        anchor: presses between two anchors, if the anchors detect the fault; 0: no anchors, which saves time.
        stops: whether the tip must first stop and go up.
    """

    name: str
    text: str
    switch: Mapping[str, Value] = field(default_factory=dict)
    lasts_s: float = FOR_EVER
    process: str = ''
    number: signal.Signals = signal.SIGKILL
    full_disk: bool = False
    expect: str = GOES_ON
    sensor: str = 'netft'
    stops: bool = True
    anchor: int = 0


CASES = (
    Case('none', 'none (for comparison)', stops=False),
    Case('lost-packets', '400 samples in a row lost (0.4 s)', {'lose': 400}),
    Case('lossy-network', '5 % of the samples lost, 5 s', {'loss_rate': 0.05}, 5.0, stops=False),
    Case('reordered-packets', '50 samples swapped with the next', {'reorder': 50}, stops=False),
    Case('doubled-packets', '50 samples sent twice', {'double': 50}, stops=False),
    Case('silent-sensor', 'sensor silent, 2.5 s', {'silent_sensor': True}, 2.5),
    Case('stalled-sensor', 'front end of the sensor stalled, 2.5 s', {'stalled_sensor': True}, 2.5),
    Case('saturated-sensor', 'sensor saturated, 2.5 s', {'saturated_sensor': True}, 2.5, expect=ASKS),
    Case('unplugged-sensor', 'serial line of the sensor pulled, 3 s', {'unplugged_sensor': True}, 3.0, sensor='bota'),
    Case('damaged-frames', '20 damaged frames on the serial line of the sensor', {'damage': 20}, sensor='bota'),
    Case('clock-jump', "sensor's clock jumps ahead by 0.3 s", {'sensor_jump_s': 0.3}, stops=False),
    Case('clock-drift', "sensor's clock runs 100 ppm fast", {'sensor_drift_ppm': 100.0}, stops=False),
    Case('silent-camera', 'camera silent, 2.5 s', {'silent_camera': True}, 2.5),
    Case('dropped-frames', '20 images in a row lost', {'lose_frames': 20}),
    Case('lossy-camera', '30 % of the images lost, 5 s', {'frame_loss_rate': 0.3}, 5.0, stops=False),
    Case('late-images', 'images 0.2 s late', {'camera_delay_s': 0.2}, stops=False),
    Case('very-late-images', 'images 3 s late, for 10 s', {'camera_delay_s': 3.0}, 10.0, stops=False),
    Case('stuck-x', 'x stops moving', {'stuck_axis': 'x'}, expect=ENDS, stops=False, anchor=3),
    Case('stuck-y', 'y stops moving', {'stuck_axis': 'y'}, expect=ENDS, stops=False, anchor=3),
    Case('stuck-z', 'z stops moving, tip in the gel', {'stuck_axis': 'z'}, expect=ENDS, stops=False),
    Case('alarm', 'controller raises alarm 1 (limit switch)', {'alarm': 1}, expect=ENDS),
    Case('hung-controller', 'controller hangs', {'hung_machine': True}, expect=ENDS),
    Case('slow-controller', "controller's messages 1 s late, 3 s", {'machine_delay_s': 1.0}, 3.0, expect=ENDS),
    Case('unplugged-controller', 'serial line of the controller pulled, 3 s', {'unplugged': True}, 3.0, expect=ENDS),
    Case('killed-rig-node', 'kill -9 of the rig node', process='rig_node', expect=ASKS),
    Case('killed-recorder', 'kill -9 of the recorder', process='recorder_node', stops=False),
    Case('killed-camera', 'kill -9 of the camera node', process='camera_node'),
    Case('killed-launch', 'kill -9 of the whole launch', process='launch', expect=ENDS),
    Case('interrupt', 'Ctrl-C of the whole launch', process='launch', number=signal.SIGINT, expect=ENDS),
    Case('full-disk', "the recorder's disk is full", process='recorder_node', full_disk=True, expect=ENDS),
)
