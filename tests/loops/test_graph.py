import networkx
import numpy as np
import pytest

from loops import (
    GrainGraph,
    InputError,
    branch_vectors,
    contact_frame,
    from_networkx,
    to_networkx,
)

PAIR = {"x": [[0, 0], [0.9, 0]], "radii": [0.5, 0.5], "contacts": [[0, 1]]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radii": [0.5, -1.0]}, ["radius of grain 1", "-1.0", "positive"]),
        ({"radii": [0.0, 0.5]}, ["radius of grain 0", "0.0", "positive"]),
        ({"x": [[0, 0], [np.nan, 0]]}, ["position of grain 1", "nan", "finite"]),
        ({"x0": [[0, 0], [np.inf, 0]]}, ["reference position of grain 1", "inf"]),
        ({"contacts": [[0, 2]]}, ["contact 0", "[0, 2]", "grains 0 to 1"]),
        ({"contacts": [[-1, 1]]}, ["contact 0", "[-1, 1]"]),
        ({"contacts": [[0, 1], [1, 0]]}, ["contact 1", "same as contact 0", "once"]),
        ({"contacts": [[1, 1]]}, ["contact 0", "grain 1 with itself"]),
        ({"x": [[0, 0], [0, 0]]}, ["contact 0", "coincident centres of grains 0 and 1"]),
        ({"x0": [[1, 1], [1, 1]]}, ["coincident reference centres of grains 0 and 1"]),
        ({"contacts": [[0.0, 1.0]]}, ["contacts", "[[0.0, 1.0]]", "integers"]),
        ({"contacts": [[0, 1, 2]]}, ["contacts", "(1, 3)", "(n, 2)"]),
        ({"normal_force": [0.1, 0.2]}, ["normal_force", "(2,)", "(..., 1)"]),
        ({"normal_force": [np.nan]}, ["normal force of contact 0", "nan"]),
        ({"shear_force": [np.inf]}, ["shear force of contact 0", "inf"]),
        ({"images": [[1, 0]]}, ["images", "without a cell"]),
        ({"cell": [[1, 0]]}, ["cell", "(1, 2)", "(..., 2, 2)"]),
        ({"cell": [[1, 2], [1, 2]]}, ["cell", "independent cell vectors"]),
        ({"cell": np.eye(2), "cell0": np.zeros((2, 2))}, ["cell0", "independent"]),
        ({"cell": [[1, 0], [0, np.nan]]}, ["cell", "nan"]),
        ({"x": [[0, 0, 0], [1, 0, 0]]}, ["x: got shape (2, 3)", "two coordinates"]),
    ],
)
def test_bad_input_names_the_grain_or_contact(change, words):
    arguments = PAIR | change
    if "normal_force" not in change and len(arguments["contacts"]) == 2:
        arguments["normal_force"] = [0.0, 0.0]
    with pytest.raises(InputError) as caught:
        GrainGraph(**arguments)
    for word in words:
        assert word in str(caught.value)


def test_bad_batch_axes_are_named():
    with pytest.raises(InputError, match="batch axes"):
        GrainGraph(**PAIR | {"normal_force": np.zeros((2, 1)), "radii": np.ones((3, 2))})


def test_bad_value_in_a_batch_names_the_grain():
    x = np.array([[[0, 0], [1, 0]], [[0, 0], [1, np.nan]]])
    with pytest.raises(InputError, match=r"position of grain 1: got \[ 1\. nan\]"):
        GrainGraph(x=x, radii=[1, 1], contacts=[[0, 1]])


def test_arrays_are_read_only_and_not_the_callers():
    x = np.array(PAIR["x"])
    graph = GrainGraph(**PAIR | {"x": x})
    x[0, 0] = 7.0
    assert graph.x[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        graph.x[0, 0] = 1.0
    with pytest.raises(AttributeError):
        graph.x = x


def test_two_images_of_one_pair_are_two_contacts_but_one_image_is_not():
    row = {"x": [[0, 0], [1, 0]], "radii": [0.5, 0.5], "cell": [[2, 0], [0, 2]]}
    both = GrainGraph(**row, contacts=[[0, 1], [0, 1]], images=[[0, 0], [-1, 0]])
    assert branch_vectors(both).tolist() == [[1.0, 0.0], [-1.0, 0.0]]
    with pytest.raises(InputError, match="contact 1"):
        GrainGraph(**row, contacts=[[0, 1], [1, 0]], images=[[-1, 0], [1, 0]])
    own = GrainGraph(**row, contacts=[[0, 0]], images=[[1, 0]])
    assert branch_vectors(own).tolist() == [[2.0, 0.0]]
    with pytest.raises(InputError, match="same as contact 0"):
        GrainGraph(**row, contacts=[[0, 0], [0, 0]], images=[[1, 0], [-1, 0]])


def test_branch_vectors_in_a_sheared_cell():
    cell = np.array([[2.0, 0.5], [0.0, 1.5]])
    graph = GrainGraph(
        x=[[0.1, 0.2], [1.0, 0.4]],
        radii=[1, 1],
        contacts=[[0, 1]],
        images=[[-1, 2]],
        cell=cell,
        cell0=np.eye(2),
    )
    expected = np.array([0.9, 0.2]) + cell @ [-1, 2]
    np.testing.assert_allclose(branch_vectors(graph)[0], expected, atol=1e-15)
    np.testing.assert_allclose(graph.reference_branches[0], [0.9 - 1, 0.2 + 2], atol=1e-15)


def test_frame_is_right_handed_and_batched():
    rng = np.random.default_rng(1)
    graph = GrainGraph(x=rng.normal(size=(3, 4, 2, 2)), radii=[1, 1], contacts=[[0, 1]])
    length, n, t = contact_frame(graph)
    assert graph.batch_shape == (3, 4)
    np.testing.assert_allclose(n[..., 0] * t[..., 1] - n[..., 1] * t[..., 0], 1.0, rtol=1e-15)
    np.testing.assert_allclose(length[..., None] * n, branch_vectors(graph), atol=1e-15)


def test_networkx_round_trip_keeps_every_array():
    graph = GrainGraph(
        x=[[0.1, 0.2], [1.0, 0.4], [0.3, 1.2]],
        x0=[[0.0, 0.2], [1.1, 0.4], [0.3, 1.3]],
        radii=[0.5, 0.6, 0.7],
        contacts=[[1, 2], [0, 1], [1, 0]],
        normal_force=[0.3, 0.2, 0.1],
        shear_force=[0.01, -0.02, 0.03],
        images=[[0, 0], [0, 0], [1, 0]],
        cell=[[2.0, 0.1], [0.0, 2.0]],
        cell0=[[2.1, 0.0], [0.0, 2.0]],
        regime=[2, 1, 0],
        rolling_moment=[0.001, 0.0, -0.002],
    )
    network = to_networkx(graph)
    assert network.number_of_edges() == 3
    back = from_networkx(network)
    for name in (
        "x",
        "x0",
        "radii",
        "contacts",
        "normal_force",
        "shear_force",
        "images",
        "cell",
        "cell0",
        "regime",
        "rolling_moment",
    ):
        np.testing.assert_array_equal(getattr(back, name), getattr(graph, name), err_msg=name)


@pytest.mark.parametrize("name", ["normal_force", "regime", "rolling_moment"])
def test_what_some_edges_alone_have_is_refused(name):
    network = to_networkx(GrainGraph(**PAIR, normal_force=[0.2], regime=[2], rolling_moment=[0.1]))
    network.add_node(2, x=(0.0, 0.9), radius=0.5)
    given = {"normal_force": 0.1, "regime": 1, "rolling_moment": 0.0}
    del given[name]
    network.add_edge(0, 2, **given)
    with pytest.raises(InputError, match=f"{name} of edges: got none on 0-2, expected it on all"):
        from_networkx(network)
    # Without a shear force an edge has none.
    network.edges[0, 2, 0][name] = 1
    assert from_networkx(network).shear_force.tolist() == [0.0, 0.0]


STATE = {"normal_force": [3.0, 2.0, 1.0], "shear_force": [0.3, -0.2, 0.1]}
STATE |= {"regime": [2, 1, 2], "rolling_moment": [0.1, 0.2, 0.3]}


def triangle():
    return GrainGraph([[0, 0], [1, 0], [0, 1.0]], [0.6] * 3, [[0, 1], [1, 2], [2, 0]], **STATE)


def test_contacts_of_renumbered_grains_keep_what_they_have():
    place = np.array([2, 0, 1])
    other = triangle().replace(
        x=triangle().x[np.argsort(place)], contacts=place[triangle().contacts]
    )
    for name, values in STATE.items():
        np.testing.assert_array_equal(getattr(other, name), values, err_msg=name)


def test_a_contact_that_is_turned_round_keeps_what_it_has():
    cell = {"images": [[0, 0], [0, 0], [1, 0]], "cell": 3 * np.eye(2)}
    graph = triangle().replace(**cell)
    other = graph.replace(contacts=graph.contacts[:, ::-1], images=-graph.images)
    np.testing.assert_array_equal(other.regime, graph.regime)
    np.testing.assert_array_equal(other.normal_force, graph.normal_force)
    with pytest.raises(InputError, match="without images"):
        graph.replace(contacts=graph.contacts[[2, 0, 1]], **graph.at_contacts([2, 0, 1]))


def test_contacts_in_another_order_need_every_field():
    rows = [2, 0, 1]
    graph, contacts = triangle(), triangle().contacts[rows]
    with pytest.raises(InputError, match="with normal_force, shear_force and without regime, roll"):
        graph.replace(
            contacts=contacts,
            **{name: np.array(STATE[name])[rows] for name in ("normal_force", "shear_force")},
        )
    with pytest.raises(InputError, match="with regime and without normal_force, shear_force, roll"):
        graph.replace(contacts=contacts, regime=[2, 2, 1])
    other = graph.replace(contacts=contacts, **graph.at_contacts(rows))
    assert other.regime.tolist() == [2, 2, 1] and other.rolling_moment.tolist() == [0.3, 0.1, 0.2]
    fewer = graph.replace(contacts=contacts[:2], **dict.fromkeys(STATE))
    assert fewer.regime is None and fewer.rolling_moment is None and not fewer.normal_force.any()


def test_fewer_contacts_need_their_fields():
    with pytest.raises(InputError, match=r"regime: got shape \(3,\), expected shape \(..., 2\)"):
        triangle().replace(contacts=[[0, 1], [1, 2]])


def test_networkx_of_the_users_own():
    network = networkx.Graph()
    network.add_node("a", x=(0, 0), radius=0.5)
    network.add_node("b", x=(1, 0), radius=0.5)
    network.add_edge("b", "a")
    assert sorted(from_networkx(network).contacts[0].tolist()) == [0, 1]
    network.add_node("c", x=(0, 1))
    with pytest.raises(InputError, match=r"node 'c'.*'radius'"):
        from_networkx(network)
    with pytest.raises(InputError, match="batch axes"):
        to_networkx(GrainGraph(x=np.zeros((2, 1, 2)), radii=[1.0], contacts=[]))
