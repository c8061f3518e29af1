"""The bus: topics, services and the graph of nodes, over ZeroMQ or inside one process."""
