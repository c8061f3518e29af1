"""What verbs share that look at a running system, or have others work: the bus, messages as text, a cluster."""
