"""From which probability an effect is named."""

EVEN = 0.5
"""Below it a name is rather wrong than right: where every effect has less, none is named."""
