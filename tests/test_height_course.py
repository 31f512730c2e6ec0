"""The height's course while the force changes: as if every frame had been asked for its own."""

import numpy as np
import pytest
from scipy import interpolate

from mtpipe.experiment.description import ForceCourse
from mtpipe.experiment.readout import force_course
from mtpipe.joint_fit.data import plateau_data
from mtpipe.joint_fit.height_course import Course, CourseSlopes, played

FRAME_S, FRAMES = 0.01, 3000
COURSES = [
    ForceCourse(-0.2),
    ForceCourse(0.04),
    ForceCourse(0.6),
    ForceCourse(-0.5, "settling", 0.1),
    ForceCourse(0.3, "settling", 0.04),
    ForceCourse(0.15, "step", 0.4),
    ForceCourse(-0.7, "step", 0.21),
]


def data():
    positions = np.random.default_rng(5).normal(size=(FRAMES, 3))
    positions[700:760] = np.nan
    return plateau_data(positions, FRAME_S, (0.3, 0.2, 0.4))


DATA = data()


def height_nm(relative):
    """A chain's, nearly."""
    return 2000.0 - 300.0 / np.sqrt(1 + np.asarray(relative))


@pytest.mark.parametrize("course", COURSES)
def test_a_course_is_what_its_nodes_say_of_every_frame(course):
    play = played(DATA, course, FRAME_S)
    nodes, relative = np.array(play.nodes), force_course(course, FRAMES)
    found = play.course(height_nm(nodes))
    between = interpolate.BarycentricInterpolator(np.log1p(nodes), height_nm(nodes))
    each = between(np.log1p(np.clip(relative, nodes[0], nodes[-1])))
    exact = DATA.spectrum.transform_of(each, 2)
    assert np.abs(found.transform - exact).max() < 1e-6 * np.abs(exact).max()
    assert found.mean_nm == pytest.approx(each.mean(), abs=1e-6)
    np.testing.assert_allclose(
        found.power, DATA.spectrum.common_power(exact, exact), rtol=1e-5, atol=1e-12
    )
    # and these are the chain's own
    assert np.abs(each - height_nm(relative)).max() < 0.02 * np.ptp(each) + 1e-9


@pytest.mark.parametrize("course", COURSES)
def test_forces_that_stand_for_the_others_have_their_mean(course):
    play = played(DATA, course, FRAME_S)
    assert play.share.sum() == pytest.approx(1)
    assert play.share @ play.standing == pytest.approx(0, abs=2e-3 * abs(course.relative_change))
    assert list(play.nodes) == sorted(play.nodes)


def test_sums_over_ordinates_are_those_of_transforms():
    shape = played(DATA, ForceCourse(0.3), FRAME_S).shape
    random = np.random.default_rng(1)
    weight = DATA.spectrum.per_ordinate(random.random(len(DATA.spectrum.frequency_hz)))
    one, other = random.normal(size=(2, len(shape.means)))
    first, second = Course(shape, one).transform, Course(shape, other).transform
    exact = np.sum(weight * np.real(first * np.conj(second)))
    assert one @ shape.in_common(weight * second) == pytest.approx(exact)
    assert one @ shape.in_common_with_itself(weight) @ other == pytest.approx(exact)
    slopes = CourseSlopes(shape, np.array([one, other]))
    assert slopes.in_common(weight * second)[0] == pytest.approx(exact)
    assert slopes.in_common_with_itself(weight)[0, 1] == pytest.approx(exact)
    np.testing.assert_allclose(
        slopes.moved(Course(shape, one), np.array([0.0, 2.0])).transform, first + 2 * second
    )


def test_weights_of_ordinates_are_those_of_bins():
    spectrum = DATA.spectrum
    weight = np.random.default_rng(2).random(len(spectrum.frequency_hz))
    first, second = spectrum.transforms[0], spectrum.transforms[2]
    by_bins = weight @ spectrum.common_power(first, second)
    by_ordinates = np.sum(spectrum.per_ordinate(weight) * np.real(first * np.conj(second)))
    assert by_ordinates == pytest.approx(by_bins)
