"""Drawing on a canvas, and the widgets beside a mechanism; knows no plant and no environment."""
