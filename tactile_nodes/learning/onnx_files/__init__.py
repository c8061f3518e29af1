"""Models as ONNX files, and a check that both give the same results."""
