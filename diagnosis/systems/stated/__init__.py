"""What the user states of a rig, what is assumed for want of that, and which systems its channels fit."""
