"""The readout `field`: normal force and shear of any contact."""
