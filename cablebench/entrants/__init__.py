"""Who takes part: controllers, policies, submitted files; what is checked before they do."""

from cablebench.entrants.apart import submission_entrant
from cablebench.entrants.controller_files import controller_file_entrant
from cablebench.entrants.entrant import BUDGETS, INFORMATION, Entrant, agent_entrant, controller_entrant
from cablebench.entrants.named import entering, named_entrant, prepared_entrants, reference_entrants

__all__ = [
    "BUDGETS", "INFORMATION", "Entrant", "agent_entrant", "controller_entrant", "controller_file_entrant",
    "entering", "named_entrant", "prepared_entrants", "reference_entrants", "submission_entrant",
]  # fmt: skip
