"""Models of a tether for lmfit: chains that add up, and an offset of the extension.

Each is an `lmfit.Model` of the mean extension in nm at a force in pN, so that they compose: a
handle of double-stranded DNA in series with a single strand is

    tether = molecule("dsDNA", 2000, temperature_K=298.0, prefix="ds_") + molecule(
        "ssDNA", 500, temperature_K=298.0, prefix="ss_") + extension_offset()

as segments in series bear the same force and their heights add. `mtpipe.fit_together` fits them.
A parameter is held by `model.set_param_hint("ss_kuhn_length_nm", vary=False)`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mtpipe.fit.points import Assay, Relation
from mtpipe.fit.tether import expected_extension_nm
from mtpipe.ground.errors import MtpipeError
from mtpipe.ground.types import FloatArray
from mtpipe.physics.jointed_chain import jointed_extension_nm
from mtpipe.physics.tether import VALIDITY, Chain, Formula, Validity

if TYPE_CHECKING:
    import lmfit

Name = Literal["dsDNA", "ssDNA", "dsRNA", "ssRNA"]
# Lengths and moduli that no tether falls below; chains are not defined at nought.
LEAST_NM, LEAST_PN = 0.05, 1.0
VALID_JOINTED = Validity((0.0, 60.0), "it has neither hairpins nor twist")


@dataclass(frozen=True)
class Molecule:
    """A molecule's chain and what its parameters start from; they are fitted unless held.

    Attributes
    ----------
    nm_per_unit : contour length of a base pair, or of a nucleotide of a single strand.
    stiffness_nm : persistence length, of a jointed chain the length of its segments.
    """

    jointed: bool
    nm_per_unit: float
    stiffness_nm: float
    stretch_modulus_pN: float | None
    valid: Validity


MOLECULES: dict[Name, Molecule] = {
    "dsDNA": Molecule(False, 0.338, 50.0, 1000.0, VALIDITY["extensible"]),
    # Smith, Cui and Bustamante 1996, Science 271:795: 1.5 nm, 800 pN, 0.56 nm, in 150 mM Na+
    "ssDNA": Molecule(
        True, 0.56, 1.5, 800.0,
        Validity((10.0, 60.0), "below, hairpins shorten it (Bosco et al. 2014, Nucleic Acids Res "
                 "42:2064)"),
    ),
    # A-form; Abels et al. 2005, Biophys J 88:2737: 62 to 64 nm; Lipfert et al. 2014, PNAS
    # 111:15408: 57 nm, 350 pN
    "dsRNA": Molecule(
        False, 0.28, 60.0, 400.0,
        Validity((0.0, 40.0), "linear stretching; it overstretches at some 60 pN (Herrero-Galan et "
                 "al. 2013, J Am Chem Soc 135:122)"),
    ),
    # a worm-like chain and no jointed one: Seol et al. 2004, Phys Rev Lett 93:118102; 1 nm and
    # 0.59 nm: Liphardt et al. 2001, Science 292:733
    "ssRNA": Molecule(
        False, 0.59, 1.0, None,
        Validity((15.0, 40.0), "below, RNA with a sequence folds (Liphardt et al. 2001, Science "
                 "292:733)"),
    ),
}  # fmt: skip


def worm_like_chain(
    *,
    temperature_K: float,
    formula: Formula = "bouchiat",
    relation: Relation = "potential",
    prefix: str = "",
    valid: Validity | None = None,
) -> lmfit.Model:
    """A worm-like chain (`mtpipe.physics.tether`): contour_length_nm, persistence_length_nm and,
    of an extensible formula, stretch_modulus_pN.

    Parameters
    ----------
    relation : between force and mean height, as of the curves that `mtpipe run` fits; "long-chain"
        is the formula as the literature fits it.
    prefix : of its parameters, where several chains are composed.
    valid : the forces for which it holds; default: those of the formula for DNA.
    """
    assay = Assay(temperature_K, relation)

    def rigid(
        force_pN: FloatArray, contour_length_nm: float, persistence_length_nm: float = 50.0
    ) -> FloatArray:
        chain = Chain(contour_length_nm, persistence_length_nm, temperature_K, formula)
        return expected_extension_nm(chain, force_pN, assay)

    def soft(
        force_pN: FloatArray,
        contour_length_nm: float,
        persistence_length_nm: float = 50.0,
        stretch_modulus_pN: float = 1000.0,
    ) -> FloatArray:
        chain = Chain(
            contour_length_nm, persistence_length_nm, temperature_K, formula, stretch_modulus_pN
        )
        return expected_extension_nm(chain, force_pN, assay)

    made = soft if formula.startswith("extensible") else rigid
    return _model(made, f"worm-like chain ({formula})", prefix, valid or VALIDITY[formula])


def freely_jointed_chain(
    *,
    temperature_K: float,
    extensible: bool = False,
    prefix: str = "",
    valid: Validity = VALID_JOINTED,
) -> lmfit.Model:
    """A freely jointed chain (`mtpipe.physics.jointed_chain`): contour_length_nm, kuhn_length_nm
    and, if extensible, stretch_modulus_pN.
    """

    def rigid(
        force_pN: FloatArray, contour_length_nm: float, kuhn_length_nm: float = 1.5
    ) -> FloatArray:
        return jointed_extension_nm(
            force_pN,
            contour_length_nm=contour_length_nm,
            kuhn_length_nm=kuhn_length_nm,
            temperature_K=temperature_K,
        )

    def soft(
        force_pN: FloatArray,
        contour_length_nm: float,
        kuhn_length_nm: float = 1.5,
        stretch_modulus_pN: float = 800.0,
    ) -> FloatArray:
        return jointed_extension_nm(
            force_pN,
            contour_length_nm=contour_length_nm,
            kuhn_length_nm=kuhn_length_nm,
            temperature_K=temperature_K,
            stretch_modulus_pN=stretch_modulus_pN,
        )

    return _model(soft if extensible else rigid, "freely jointed chain", prefix, valid)


def extension_offset() -> lmfit.Model:
    """An offset of the extension, offset_nm: what has to be added to measured extensions."""

    def shift(force_pN: FloatArray, offset_nm: float = 0.0) -> FloatArray:
        return np.zeros_like(force_pN) - offset_nm

    return _model(shift, "offset", "", None)


def molecule(
    name: Name, units: float, *, temperature_K: float, extensible: bool = True, prefix: str = ""
) -> lmfit.Model:
    """The chain of a molecule, its parameters beginning where the literature has them.

    Parameters
    ----------
    name : "dsDNA", "ssDNA", "dsRNA" or "ssRNA"; sources stand in `MOLECULES`.
    units : base pairs, or nucleotides of a single strand.
    extensible : False: it does not stretch, for forces up to some 10 pN.

    Raises
    ------
    MtpipeError : no such molecule.
    """
    if name not in MOLECULES:
        known = ", ".join(MOLECULES)
        raise MtpipeError(f"there is no molecule {name!r} here", mend=f"Known: {known}.")
    kind = MOLECULES[name]
    soft = extensible and kind.stretch_modulus_pN is not None
    if kind.jointed:
        model = freely_jointed_chain(
            temperature_K=temperature_K, extensible=soft, prefix=prefix, valid=kind.valid
        )
    else:
        single = name.startswith("ss")
        model = worm_like_chain(
            temperature_K=temperature_K,
            formula="extensible" if soft else "bouchiat",
            relation="long-chain" if single else "potential",
            prefix=prefix,
            valid=kind.valid if soft or single else VALIDITY["bouchiat"],
        )
    stiffness = "kuhn_length_nm" if kind.jointed else "persistence_length_nm"
    model.set_param_hint("contour_length_nm", value=units * kind.nm_per_unit)
    model.set_param_hint(stiffness, value=kind.stiffness_nm)
    if soft:
        model.set_param_hint("stretch_modulus_pN", value=kind.stretch_modulus_pN)
    return model


def valid_for(model: lmfit.Model) -> Validity:
    """The forces for which every part of a model holds, and why no others."""
    parts = [one.func.validity for one in model.components]
    parts = [one for one in parts if one is not None]
    low = max((one.force_range_pN[0] for one in parts), default=0.0)
    high = min((one.force_range_pN[1] for one in parts), default=np.inf)
    return Validity((low, high), "; ".join(dict.fromkeys(one.reason for one in parts)))


def name_of(model: lmfit.Model) -> str:
    """A model in words: its parts."""
    return " + ".join(one.func.words for one in model.components)


def _model(
    function: Callable[..., FloatArray], words: str, prefix: str, valid: Validity | None
) -> lmfit.Model:
    import lmfit

    made: Any = function
    made.words, made.validity = words, valid
    model = lmfit.Model(made, independent_vars=["force_pN"], prefix=prefix, name=words)
    for name in model.param_names:
        bare = name.removeprefix(prefix)
        if bare != "offset_nm":
            model.set_param_hint(bare, min=LEAST_PN if bare.endswith("_pN") else LEAST_NM)
    return model
