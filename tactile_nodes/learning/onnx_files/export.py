"""Exports a model file to ONNX, for runtimes other than numpy, with the model's card inside."""

from __future__ import annotations

import json
from pathlib import Path

from tactile_nodes.errors import ModelError, in_a_line
from tactile_nodes.learning.onnx_files.graph import Writer
from tactile_nodes.learning.onnx_files.network import write_network
from tactile_nodes.learning.onnx_files.parts import write_answer, write_inputs
from tactile_nodes.learning.onnx_files.response import write_response
from tactile_nodes.model_file import LoadedModel
from tactile_nodes.paths import check_output, write_whole
from tactile_nodes.sensing.explain.field.readout import FieldReadout
from tactile_nodes.sensing.explain.measured.readout import ResponseReadout
from tactile_nodes.sensing.explain.network import NetworkReadout

_MEANING = (
    'Normal force on each bin of a soft gel, from the motion of its markers. Made with tactile_nodes; the property '
    '"card" says how the features are measured and what the numbers mean.'
)


def onnx_bytes(loaded: LoadedModel) -> bytes:
    """The model as an ONNX file's content, checked by onnx.

    Its outputs are those of `ForceEstimator`, with the strongest contact only: `contacts` in its properties is 1.

    Raises:
        ConfigurationError: the package onnx is not installed.
        ModelError: this kind of readout has no graph yet.
    """
    writer, readout = Writer(), loaded.model.readout
    if isinstance(readout, FieldReadout):
        raise ModelError(
            f'model {loaded.model_id} is a force field, which is solved frame by frame, and ONNX cannot hold that '
            'solver: its first, linear estimate alone smears force over the surface; run it with tactile_nodes '
            '(tactile launch live, without torch), or export fast, which reads tips'
        )
    if not isinstance(readout, NetworkReadout | ResponseReadout):
        raise ModelError(
            f'model {loaded.model_id} is {readout.kind}, which cannot be exported; export a network or a measured '
            'response, such as fast, or use tactile_nodes itself, which needs no torch'
        )
    layer = readout.layer if isinstance(readout, NetworkReadout) else None
    inputs = write_inputs(writer, loaded.model.layout, readout.scaling, layer)
    if isinstance(readout, NetworkReadout):
        answer = write_network(writer, readout, inputs)
    else:
        answer = write_response(writer, readout, inputs)
    write_answer(writer, answer, inputs, loaded.model.bins)
    properties = {
        'format': 'tactile_nodes.force_model',
        'model_id': loaded.model_id,
        'contacts': '1',
        'card': json.dumps(dict(loaded.card), sort_keys=True),
    }
    content: bytes = writer.model(_MEANING, properties).SerializeToString(deterministic=True)
    return content


def export_onnx(loaded: LoadedModel, file: Path) -> int:
    """Write the model as ONNX. Returns the file's size in bytes.

    Raises:
        ConfigurationError: the package onnx is not installed, or no file can be written there.
        ModelError: writing failed, for example on a full disk.
    """
    check_output(file)
    try:
        content = onnx_bytes(loaded)
    except (ArithmeticError, LookupError, TypeError, ValueError, MemoryError) as error:
        raise ModelError(
            f'model {loaded.model_id} holds what no gel has and cannot be exported ({in_a_line(error)}); train it again'
        ) from error
    try:
        write_whole(file, content)
    except OSError as error:
        raise ModelError(f'cannot write {file} ({error.strerror}); choose another place with -o FILE') from error
    return len(content)
