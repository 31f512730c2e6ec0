"""Other calibration methods of the field, by name, for comparison and for those who must.

Every method is exact for any exposure as far as its own scheme allows, states its errors, and says
"not identified" where it cannot tell.
"""

from mtpipe.methods.by_name import METHODS, fit_by_method
from mtpipe.methods.result import MethodFit

__all__ = ["METHODS", "MethodFit", "fit_by_method"]
