"""What a session makes of its settings."""

from __future__ import annotations

import pytest

from tactile_nodes import params
from tactile_nodes.clock import SystemClock
from tactile_nodes.collection.press.speed import longest_period_s
from tactile_nodes.collection.run.session import RigSettings, with_indenter
from tactile_nodes.drivers.cnc.contract import CncSettings
from tactile_nodes.drivers.force_torque.contract import ForceTorqueSettings
from tactile_nodes.drivers.force_torque.simulated import SimulatedForceTorque
from tactile_nodes.emulators.world import WorldSettings
from tactile_nodes.errors import ConfigurationError
from tactile_nodes.paths import share_directory

REAL = CncSettings(source='/dev/ttyUSB0')


def named(settings: RigSettings) -> str:
    return with_indenter(settings).press.indenter


@pytest.mark.parametrize(
    ('indenter', 'name'), [('tip', 'sphere 1.2 mm'), ('ball', 'sphere 6 mm'), ('punch', 'flat punch 3 mm')]
)
def test_simulated_machine_presses_with_what_its_world_says(indenter: str, name: str) -> None:
    assert named(RigSettings(world=WorldSettings(indenter=indenter))) == name


def test_real_rig_presses_with_what_a_person_says() -> None:
    assert named(RigSettings(cnc=REAL, world=WorldSettings(indenter='ball'))) == 'sphere 1.2 mm'


def test_shipped_emulated_rig_names_what_its_world_presses_with() -> None:
    """The rig node reads the same wildcard block as the emulated rig."""
    config = share_directory() / 'config'
    files = [config / 'collect.yaml', config / 'rigs' / 'emulated.yaml']
    sources = [each for file in files for each in params.load_parameter_file(file)]
    launched = '/**: {ros__parameters: {cnc.source: collection/cnc, world.indenter: punch}}'
    sources += params.parse_parameters(launched, 'the test')
    values = params.resolve_parameters('/rig', sources)
    assert named(params.from_mapping(RigSettings, values, source='the test')) == 'flat punch 3 mm'


def test_a_sensor_that_is_lost_while_the_plan_is_ordered_still_has_a_period() -> None:
    """Ordering a plan of thousands of presses takes minutes; a lost sensor has no rate until it is found again."""
    lost = SimulatedForceTorque(ForceTorqueSettings(rate_hz=100.0), SystemClock())
    assert lost.rate_hz == 0.0
    assert longest_period_s(lost) == pytest.approx(0.01)


@pytest.mark.parametrize(
    'setting', ['press.frames: 91', 'press.rest_frames: 91', 'reference_frames: 91', 'press.window_s: 30.0']
)
def test_more_images_and_samples_than_are_kept_are_refused(setting: str) -> None:
    """90 images and 20 s of samples are kept: every press would be rejected, as if the camera were at fault."""
    sources = params.parse_parameters(f'/**: {{ros__parameters: {{{setting}}}}}', 'the test')
    with pytest.raises(ConfigurationError, match='must be from'):
        params.from_mapping(RigSettings, params.resolve_parameters('/rig', sources), source='the test')
