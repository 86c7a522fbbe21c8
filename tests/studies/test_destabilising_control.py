import numpy as np

from studies.destabilising_control import study


def test_the_controls_lose_strength():
    """Isotropic: no slope at the state, lost in one sense. Inside the cone: falls in both."""
    controls, responses = study()
    for name, found in responses.items():
        by_label = {label: (strain, strength) for label, strain, strength in found}
        isotropic, softening = (
            controls[name][k] for k in ("isotropic direction", "inside the cone")
        )
        assert abs(isotropic["slope"]) < 1e-14
        assert softening["slope"] < -1e-3
        lost = 0
        for sense in "+-":
            strain, strength = by_label[f"inside the cone, {sense}"]
            early = (strain > 0) & (strain < 0.01)
            assert (strength[early] < 0).all()
            np.testing.assert_allclose(
                strength[early] / strain[early], softening["slope"], rtol=0.3
            )
            lost += by_label[f"isotropic direction, {sense}"][1][-1] < 0
        assert lost >= 1
