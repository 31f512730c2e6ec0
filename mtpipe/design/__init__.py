"""Guidelines for an experiment: which forces it can measure, what limits them, what would help.

No data: Fisher information of the exact model (`mtpipe.fit`), and what other methods of the field
make of the spectra that the described experiment is expected to give.
"""

from mtpipe.design.guide import Design, measurable_forces
from mtpipe.design.plan import Plan, plan_of

__all__ = ["Design", "Plan", "measurable_forces", "plan_of"]
