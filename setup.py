"""What pip installs. (colcon builds the same tree through CMakeLists.txt; package.xml says so.)

Tried versions stand in constraints.txt; here are the ranges that they lie in.
"""

import re
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).parent
SHARE = Path('share/tactile_nodes')
VERSION = '0.2.0'
HOME = 'https://github.com/tactile-nodes/tactile_nodes'

CYCLONE = 'cyclonedds==11.0.1'  # tactile_nodes/dds/endpoints.py uses a part of it that may change

# trimesh finds the lower side of a mesh with embreex, or more slowly with rtree, where embreex has no wheels.
MESH = [
    'trimesh>=4.6,<6',
    'embreex>=2.17,<5; platform_machine == "x86_64"',
    'rtree>=1.4,<2; platform_machine != "x86_64"',
]

NODES = [
    'camera',
    'flow_features',
    'force_estimator',
    'recorder',
    'player',
    'bridge',
    'rig',
    'emulated_rig',
    'sync_input',
    'calibrator',
    'drift_monitor',
    'live_view',
    'force_views',
    'guarded_approach',
    'hand_sensors',
    'hand_wrench',
    'simulated_gripper',
    'guarded_grasp',
    'dds_bridge',
    'foxglove_bridge',
    'composed',
]


def module_of(node: str) -> str:
    """The module of a node, which may lie in a folder of its kind."""
    (file,) = (ROOT / 'tactile_nodes' / 'nodes').rglob(f'{node}.py')
    return '.'.join(file.relative_to(ROOT).with_suffix('').parts)


def shared_files() -> list[tuple[str, list[str]]]:
    """The folders that ROS 2 and `paths.share_directory` expect below share/tactile_nodes."""
    found = [('share/ament_index/resource_index/packages', ['resource/tactile_nodes']), (str(SHARE), ['package.xml'])]
    for top in ('msg', 'launch', 'config', 'models'):
        for folder in [ROOT / top, *(path for path in (ROOT / top).rglob('*') if path.is_dir())]:
            files = [str(path.relative_to(ROOT)) for path in sorted(folder.iterdir()) if path.is_file()]
            if files:
                found.append((str(SHARE / folder.relative_to(ROOT)), files))
    return found


def description() -> str:
    """The README, with links that also work where the files beside it are not: on the page of a package index."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    text = re.sub(r'(!\[[^]]*]\()(?!https?:)', rf'\1{HOME}/raw/v{VERSION}/', text)
    return re.sub(r'(?<!!)(\[[^]]*]\()(?!https?:|#)', rf'\1{HOME}/blob/v{VERSION}/', text)


setup(
    name='tactile_nodes',
    version=VERSION,
    description='Vision-based touch sensing: normal force and shear on a soft gel, in newtons, from a camera under it',
    long_description=description(),
    long_description_content_type='text/markdown',
    author='tactile_nodes maintainers',
    author_email='maintainers@tactile-nodes.org',
    maintainer='tactile_nodes maintainers',
    maintainer_email='maintainers@tactile-nodes.org',
    url=HOME,
    download_url=f'{HOME}/releases',
    project_urls={
        'Documentation': f'{HOME}/blob/v{VERSION}/docs/README.md',
        'Changes': f'{HOME}/blob/v{VERSION}/CHANGELOG.md',
        'Source': HOME,
        'Issues': f'{HOME}/issues',
        'Security': f'{HOME}/security/policy',
        'Paper': 'https://doi.org/10.1109/IROS40897.2019.8967571',
    },
    keywords=[
        'tactile sensing',
        'vision-based tactile sensor',
        'force distribution',
        'shear force',
        'robotics',
        'ROS 2',
        'optical flow',
        'soft gel',
        'calibration',
    ],
    license='Apache-2.0',
    license_files=['LICENSE', 'tactile_nodes/web/static/uplot/LICENSE'],
    classifiers=[
        'Development Status :: 4 - Beta',
        'Environment :: Console',
        'Intended Audience :: Developers',
        'Intended Audience :: Science/Research',
        'Natural Language :: English',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Programming Language :: Python :: 3 :: Only',
        'Programming Language :: Python :: 3.10',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Programming Language :: Python :: 3.14',
        'Programming Language :: Python :: Implementation :: CPython',
        'Topic :: Scientific/Engineering',
        'Topic :: Scientific/Engineering :: Image Processing',
        'Topic :: System :: Hardware :: Hardware Drivers',
        'Typing :: Typed',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=['tactile_nodes', 'tactile_nodes.*']),
    package_data={
        'tactile_nodes': ['py.typed'],
        'tactile_nodes.messages': ['definitions.json', 'types.pyi'],
        'tactile_nodes.web': ['static/*', 'static/js/*', 'static/uplot/*'],
    },
    data_files=shared_files(),
    install_requires=[
        'aiohttp>=3.14.4,<4',
        'argcomplete>=3.5,<4',
        'mcap>=1.5,<2',
        'numba>=0.61,<0.69',
        'numpy>=1.26,<3',
        'opencv-contrib-python-headless>=4.10,<6',
        'psutil>=6,<8',
        'pyserial>=3.5,<4',
        'pyyaml>=6,<7',
        'pyzmq>=26,<28',
        'rich>=13,<16',
        'rosbags>=0.11.7,<0.12',
        'safetensors>=0.5,<1',
        'scipy>=1.15,<2',
    ],
    extras_require={
        'train': ['torch>=2.4,<3', 'matplotlib>=3.10.9,<4'],
        'onnx': ['onnx>=1.17,<2', 'onnxruntime>=1.20,<2'],
        'export': ['pyarrow>=17,<27', 'zarr>=3.1,<4; python_version >= "3.11"'],
        'bridge': ['eclipse-zenoh>=1.10,<2', 'cryptography>=44,<51'],
        'compiled': [],  # what it brought comes with all installs now
        'cluster': ['distributed>=2025.1,<2027'],
        'mesh': MESH,
        'dds': [CYCLONE],
        'docs': ['mkdocs>=1.6,<2', 'mkdocs-material>=9.7,<10', 'mkdocstrings[python]>=1,<2'],
        'dev': [
            'beartype>=0.20,<1',
            'cryptography>=44,<51',
            f'{CYCLONE}; platform_machine == "x86_64" and python_version < "3.14"',  # where there are wheels
            'distributed>=2025.1,<2027',
            'eclipse-zenoh>=1.10,<2',
            'hypothesis>=6.168,<7',
            'import-linter>=2.1,<3',
            'jaxtyping>=0.3,<0.4',
            'markdown-it-py>=3,<5',
            'mypy>=2.4,<3',
            'onnx>=1.17,<2',
            'onnxruntime>=1.20,<2',
            'playwright>=1.50,<2',
            'pyarrow>=17,<27',
            'pynetft>=2.1,<3',
            'pytest>=9,<10',
            'pytest-rerunfailures>=16.7,<17',
            'pytest-timeout>=2.3,<3',
            'pytest-xdist>=3.6,<4',
            'ruff>=0.17.5,<0.18',
            *MESH,
            'types-PyYAML>=6,<7',
            'types-psutil>=6,<8',
            'types-pyserial>=3.5,<4',
            'zarr>=3.1,<4; python_version >= "3.11"',
        ],
    },
    entry_points={
        'console_scripts': [
            'tactile = tactile_nodes.cli.main:main',
            *(f'tactile_{name}_node = {module_of(name)}:main' for name in NODES),
        ],
    },
)
