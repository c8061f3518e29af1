"""Code that subcommands share: the bus of a running system, a cluster, messages and tables as text."""
