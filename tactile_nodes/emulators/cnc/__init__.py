"""Controllers of machines, as a host on their serial line sees them."""
