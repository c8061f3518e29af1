"""Robots need no wheel but those that `pip install tactile_nodes` brings."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tactile_nodes.paths import share_directory

CODE = """
import importlib, pkgutil, sys
for name in ('torch', 'onnx', 'onnxruntime', 'matplotlib'):
    sys.modules[name] = None  # makes every import of it fail
from tactile_nodes import nodes
for each in pkgutil.iter_modules(nodes.__path__):
    importlib.import_module(f'tactile_nodes.nodes.{each.name}')
import numpy as np
from tactile_nodes import conversions
from tactile_nodes.bus import topics
from tactile_nodes.bus.node.arguments import parse_arguments
from tactile_nodes.bus.inprocess import InProcessBus
from tactile_nodes.messages import types
from tactile_nodes.model_file import load_model
from tactile_nodes.nodes.force_estimator import ForceEstimatorNode

for file in sys.argv[1:]:
    bus, layout = InProcessBus(), load_model(file).model.layout
    node = ForceEstimatorNode(bus, parse_arguments(['--ros-args', '-p', f'model:={file}', '-p', 'compiled:=false']))
    forces = bus.subscribe('/force_distribution', topics.FORCE_DISTRIBUTION.type_name, topics.FORCE_DISTRIBUTION.qos)
    source = bus.advertise('/flow_features', topics.FLOW_FEATURES.type_name, topics.FLOW_FEATURES.qos)
    source.publish(types.FlowFeatures(
        header=conversions.header(10**18, 'camera'), rows=layout.rows, cols=layout.cols, channels=layout.channels,
        encoding=layout.encoding, values=np.zeros(layout.count, np.float32),
        confidence=np.ones(layout.rows * layout.cols, np.float32), reference_id='0',
    ))
    node.spin_once()
    print(len(forces.get(30.0).message.normal_force))
    node.close()
    bus.close()
"""


def test_a_network_and_a_response_are_served_where_only_numpy_is(small_model: Path) -> None:
    command = [sys.executable, '-c', CODE, str(small_model), str(share_directory() / 'models' / 'fast.safetensors')]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, timeout=50)
    assert ended.stdout.split() == ['9', '81']
