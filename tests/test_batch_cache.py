"""What was worked out last is kept for a while."""

from hypothesis import given
from hypothesis import strategies as st

from mtpipe.joint_fit.batch_cache import BatchCache


@given(
    most=st.integers(1, 5),
    steps=st.lists(st.tuples(st.booleans(), st.integers(0, 8)), max_size=40),
)
def test_those_asked_for_last_are_known(most, steps):
    recent, order = BatchCache(most), []
    for puts, key in steps:
        if puts:
            recent.put(key, f"value {key}")
        else:
            assert recent.get(key) == (f"value {key}" if key in order else None)
        if puts or key in order:
            order = [*(one for one in order if one != key), key][-most:]
    assert [key for key in range(9) if recent.get(key) is not None] == sorted(order)
