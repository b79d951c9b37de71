"""The one-axis drive: its simulation under a controller or held to what was recorded, and the controller."""
