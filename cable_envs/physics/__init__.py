"""The papers' equations as scalar functions: wrapped contact, extrusion, supports, dry friction, chain."""
