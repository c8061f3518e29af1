"""Which forces on the surface explain the motion that is seen: any contact, a few tips, or nothing."""
