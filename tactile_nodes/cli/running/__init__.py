"""What the verbs that look at a running system share: joining the bus, and messages as text."""
