"""Text by a grammar (hypothesis): TOML, CSV and tables of numbers, valid or nearly so.

Texts come in blocks, whose seed is the block's number: an example is found again by its number, in
the same version of hypothesis.
"""

from __future__ import annotations

from functools import lru_cache

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

BLOCK = 40
_ANY = st.text(max_size=12)
_NUMBERS = st.one_of(
    st.integers().map(str),
    st.floats().map(repr),
    st.sampled_from(("1e400", "-0", "0x1F", "1_0", "+inf", "nan", "9" * 5000, "1e-400")),
)
_KEYS = st.one_of(
    st.sampled_from(
        (
            "schema",
            "camera",
            "camera.frame_rate_hz",
            "frame_rate_hz",
            "exposure_s",
            "beads",
            "radius_nm",
            "reference",
            "tether",
            "contour_length_nm",
            "persistence_length_nm",
            "buffer",
            "temperature_K",
            "viscosity_mPa_s",
            "field",
            "direction",
            "source",
            "magnet",
            "position_mm",
            "force_pN",
            "model",
            "effects",
            "tracking",
            "regions",
            "drift",
            "cutoff_hz",
            '"a\\nb"',
            '"\\u2028"',
            "a.b.c.d",
        )
    ),
    _ANY.map(lambda text: f'"{text}"'),
)
_SCALARS = st.one_of(
    _NUMBERS,
    _ANY.map(lambda text: f'"{text}"'),
    st.sampled_from(
        (
            '"unknown"',
            '"x"',
            "true",
            "1979-05-27T07:32:00Z",
            "07:32:00",
            "1979-05-27",
            '"""',
            "'''",
            '"\\ud800"',
            '"\\U00110000"',
            "{}",
            "[]",
            "[" * 5000,
            "{a=" * 3000,
            "",
        )
    ),
)
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3).map(lambda parts: f"[{', '.join(parts)}]"),
        st.lists(st.tuples(_KEYS, inner), max_size=3).map(
            lambda pairs: "{" + ", ".join(f"{k} = {v}" for k, v in pairs) + "}"
        ),
    ),
    max_leaves=5,
)
_LINES = st.one_of(
    st.tuples(_KEYS, _VALUES).map(lambda pair: f"{pair[0]} = {pair[1]}"),
    _KEYS.map(lambda key: f"[{key}]"),
    _KEYS.map(lambda key: f"[[{key}]]"),
    _ANY,
)
SETUPS = st.lists(_LINES, max_size=12).map("\n".join)

_NAMES = st.one_of(
    st.sampled_from(
        (
            "time_s",
            "frame",
            "magnet_mm",
            "b1_x_nm",
            "b1_y_nm",
            "b1_z_nm",
            "ref1_x_nm",
            "b1_quality",
            "Time",
            "Magnet",
            "X",
            "Y",
            "Z",
            "z_nm",
            "turns",
        )
    ),
    _ANY,
)
_CELLS = st.one_of(
    _NUMBERS,
    st.floats(-1e4, 1e4).map(repr),
    st.sampled_from(("", "nan", "NA", '"1"', '"', "''", "1,5", "-1.#IND000", "12:00:01")),
    _ANY,
)


@st.composite
def _tables(draw: st.DrawFn, marks: tuple[str, ...]) -> str:
    mark, end = draw(st.sampled_from(marks)), draw(st.sampled_from(("\n", "\n", "\r\n", "\r")))
    width = draw(st.integers(1, 9))
    header = draw(st.lists(_NAMES, min_size=width, max_size=width))
    plain = draw(st.booleans())
    cells = st.integers(-1000, 1000).map(str) if plain else _CELLS
    rows = draw(st.lists(st.lists(cells, min_size=width, max_size=width), max_size=12))
    odd = draw(st.lists(st.lists(_CELLS, max_size=12), max_size=2))
    at = draw(st.integers(0, len(rows)))
    lines = [header, *rows[:at], *odd, *rows[at:]]
    return end.join(mark.join(line) for line in lines) + draw(st.sampled_from((end, "")))


CSV = _tables((",", ",", ",", ";", "\t"))
TEXT = _tables(("\t", " ", "  ", ",", ";"))


def example(texts: st.SearchStrategy[str], number: int) -> str:
    """Text `number` by a grammar."""
    found = _block(texts, number // BLOCK)
    return found[number % BLOCK % len(found)]


@lru_cache(maxsize=4)
def _block(texts: st.SearchStrategy[str], block: int) -> list[str]:
    found: list[str] = []

    @seed(block)
    @settings(
        max_examples=BLOCK,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(texts)
    def collect(text: str) -> None:
        found.append(text)

    collect()
    return found
