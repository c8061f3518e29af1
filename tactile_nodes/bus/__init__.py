"""The bus: topics, services and the graph of who offers what, over ZeroMQ or inside one process."""
