"""The tree that `colcon build` installs, with stand-ins for ament's and rosidl's CMake files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from ros2_here import EMULATOR, ROOT, run

from tactile_nodes.errors import NOT_AGAIN

STAND_INS = Path(__file__).parent / 'cmake_emulator'
SITE = Path('lib/python3/site-packages')

pytestmark = pytest.mark.skipif(not (shutil.which('cmake') and shutil.which('cc')), reason='needs CMake and a compiler')


@pytest.fixture(scope='module')
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the package was installed."""
    build, made = tmp_path_factory.mktemp('build'), tmp_path_factory.mktemp('install')
    stand_ins = [f'-D{file.stem.removesuffix("Config")}_DIR={STAND_INS}' for file in STAND_INS.glob('*Config.cmake')]
    run(['cmake', '-S', str(ROOT), '-B', str(build), f'-DCMAKE_INSTALL_PREFIX={made}', *stand_ins], dict(os.environ))
    run(['cmake', '--install', str(build)], dict(os.environ))
    return made


def _environment(prefix: Path, **more: str) -> dict[str, str]:
    paths = [str(prefix / SITE), str(EMULATOR)]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths), 'ROS_DOMAIN_ID': '75', **more}


def _python(prefix: Path, code: str) -> str:
    return run([sys.executable, '-c', code], _environment(prefix), cwd=prefix).strip()


def test_our_modules_and_the_generated_ones_are_one_package(prefix: Path) -> None:
    code = 'import tactile_nodes, tactile_nodes.msg as m; print(tactile_nodes.__version__, m.GENERATED, m.__file__)'
    version, generated, place = _python(prefix, code).split()
    assert (version, generated, Path(place)) == ('0.2.0', 'True', prefix / SITE / 'tactile_nodes/msg/__init__.py')


def test_shared_files_are_found_below_the_prefix(prefix: Path) -> None:
    share = Path(_python(prefix, 'from tactile_nodes.paths import share_directory; print(share_directory())'))
    assert share == prefix / 'share/tactile_nodes'
    for name in ('package.xml', 'launch/live.launch.yaml', 'config/live.yaml', 'msg/ForceDistribution.msg'):
        assert (share / name).is_file()
    assert list((share / 'models').iterdir())


def test_messages_are_known_from_the_installed_definitions(prefix: Path) -> None:
    code = 'from tactile_nodes import messages; print(messages.type_hash("tactile_nodes/msg/ForceDistribution"))'
    assert _python(prefix, code).startswith('RIHS01_')


def test_programs_can_be_executed_also_through_links_to_the_build_folder(prefix: Path) -> None:
    programs = sorted((prefix / 'lib/tactile_nodes').iterdir())
    assert [program.name for program in programs if not os.access(program, os.X_OK)] == []
    assert {'camera_node', 'composed_node', 'tactile'} <= {program.name for program in programs}


def test_program_of_a_node_joins_the_graph_of_ros_2(prefix: Path) -> None:
    """Shown by its refusal where there is no rclpy."""
    program = prefix / 'lib/tactile_nodes/flow_features_node'
    environment = _environment(prefix, PYTHONPATH=str(prefix / SITE))
    environment.pop('TACTILE_BUS', None)
    code = f'import sys, runpy; sys.modules["rclpy"] = None; sys.argv = [{str(program)!r}]; runpy.run_path(sys.argv[0])'
    ended = subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == NOT_AGAIN
    assert ended.stderr.startswith('TACTILE_BUS=ros2 needs rclpy')


def test_tactile_runs_from_there(prefix: Path) -> None:
    program = str(prefix / 'lib/tactile_nodes/tactile')
    assert '/parameter_events' in run(
        [sys.executable, program, 'topic', 'list'], _environment(prefix, TACTILE_BUS='ros2')
    )


def test_tests_import_what_is_installed_where_ros_2_was_sourced(prefix: Path) -> None:
    code = """if True:
        import pytest, sys

        class Told:
            def pytest_collection_finish(self):
                import tactile_nodes
                print('\\nfound', tactile_nodes.__file__)

        sys.exit(pytest.main(sys.argv[1:], plugins=[Told()]))"""
    words = ['-p', 'pytest_timeout', '-p', 'no:cacheprovider', '--collect-only', __file__]
    environment = _environment(prefix, PYTEST_DISABLE_PLUGIN_AUTOLOAD='1')
    said = run([sys.executable, '-c', code, '-c', str(ROOT / 'pyproject.toml'), *words], environment, cwd=prefix)
    assert f'found {prefix / SITE / "tactile_nodes/__init__.py"}' in said.splitlines()
