"""Models as ONNX files, and the check that they answer alike."""
