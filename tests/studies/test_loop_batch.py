import numpy as np

from studies.loop_batch import errors, random_batch


def test_errors_stay_within_what_is_stated():
    """Every operator within its stated bound; 1e-10 of its norm where the condition is good."""
    batch = random_batch(200, 6, seed=3)
    for closure in ("affine", "traction"):
        found = errors(batch, closure, np.arange(25))
        assert (found["operator"] <= 4 * found["bound"]).all()
        good = found["bound"] < 1e-10
        assert good.mean() > 0.8
        assert found["operator"][good].max() < 1e-10
        assert found["eigenvalues"][good].max() < 1e-10
    assert random_batch(5, 4, seed=1).graph.batch_shape == (5,)
