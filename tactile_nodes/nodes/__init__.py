"""The nodes: one file each, a thin shell around what computes. They meet on the bus, never in an import."""
