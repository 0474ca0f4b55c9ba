"""How packaged navigators are made: one for each vehicle, or one estimator for all."""

from __future__ import annotations

import pytest

from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.navigators import NAVIGATORS, Context, build, build_central, options_of

CONTEXT = Context(0, 3, 1500.0, 1, None, (True, False, False))


@pytest.mark.parametrize("name", list(NAVIGATORS))
def test_each_is_made_by_one_of_two_functions(name: str) -> None:
    options = options_of(name)
    if NAVIGATORS[name].central:
        assert isinstance(build_central(name, CONTEXT, options), _native.CentralEstimator)
        with pytest.raises(
            NavigatorError, match=f"'{name}' is one estimator for the whole team: build_central"
        ):
            build(name, CONTEXT, options, None)
    else:
        assert isinstance(build(name, CONTEXT, options, None), _native.Navigator)
        with pytest.raises(NavigatorError, match=f"'{name}' is of one vehicle: build makes it"):
            build_central(name, CONTEXT, options)


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    unknown = r"navigator 'mfp' is unknown; did you mean 'mpf'\?"
    with pytest.raises(NavigatorError, match=unknown):
        build("mfp", CONTEXT, options_of("mpf"), None)
    with pytest.raises(NavigatorError, match=unknown):
        build_central("mfp", CONTEXT, options_of("mpf"))
