"""What a benchmark is made of: protocol, episodes and their metrics, what acts in an episode, units for people."""

from cablebench.protocol.actors import Actor, ControllerActor, PolicyActor
from cablebench.protocol.episode import Episode
from cablebench.protocol.files import load_protocol, parse_protocol
from cablebench.protocol.metrics import METRICS, measure, metric
from cablebench.protocol.protocol import Cell, Protocol, Task, Track

__all__ = [
    "METRICS", "Actor", "Cell", "ControllerActor", "Episode", "PolicyActor", "Protocol", "Task", "Track",
    "load_protocol", "measure", "metric", "parse_protocol",
]  # fmt: skip
