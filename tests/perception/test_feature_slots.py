"""Slots: columns of sets by name, moments over filled slots, and what does not fit."""

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.perception.feature_slots import Slots, slots_of
from swarmdata.perception.frames import find_frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.model_choice import with_models


def found(name: str = "coop_nav", observation: str = "state", communication: str = "none") -> Slots:
    features = features_of(make_task(with_models(preset(name), observation, communication)))
    names = tuple(feature.name for feature in features)
    return slots_of(names, find_frame(features, "target"))


def test_every_number_of_a_slot_belongs_to_it_also_what_the_frame_adds() -> None:
    slots = found("coop_nav", "state-2+stack-2", "goal")
    kinds = {kind.name: kind for kind in slots.kinds}
    assert set(kinds) == {"neighbor", "obstacle", "neighbor[-1]", "obstacle[-1]", "message"}
    assert [kind.n_slots for kind in kinds.values()] == [2, 3, 2, 3, 3]
    assert kinds["neighbor"].fields == ("dx", "dy", "dvx", "dvy", "near_x", "near_y", "closing")
    assert kinds["neighbor[-1]"].fields == kinds["neighbor"].fields[:-1]
    assert kinds["message"].fields[-4:] == ("age", "near_x", "near_y", "closing")
    assert {"own.vx", "own.vy[-1]", "frame.x"} <= set(slots.own)
    assert not {"own.x", "own.y[-1]", "message.sender"} & set(slots.fields)


def test_ordered_slots_are_no_sets_and_unassigned_goals_are_one() -> None:
    formation = found("formation")
    assert "preview_1.offset_x" in formation.own
    goals = found("coop_nav-unassigned").kinds[-1]
    assert (goals.name, goals.n_slots, goals.masks) == ("goal", 4, ())


def test_moments_are_those_of_the_slots_that_hold_something() -> None:
    slots, numbers = found(), np.random.default_rng(0)
    rows = numbers.normal(2.0, 3.0, (500, slots.n_columns))
    neighbors = slots.kinds[0]
    filled = numbers.random((500, 3)) < [0.9, 0.5, 0.0]
    for k, (columns, mask) in enumerate(zip(neighbors.columns, neighbors.masks, strict=True)):
        rows[:, [*columns, mask]] *= filled[:, k, None]
        rows[:, mask] = filled[:, k]
    mean, std = slots.moments(rows.mean(0), rows.std(0))
    first = slots.fields.index("neighbor.dvx")
    values = rows[:, [columns[2] for columns in neighbors.columns]][filled]
    assert mean[first] == pytest.approx(values.mean())
    assert std[first] == pytest.approx(values.std())
    centers, scales = slots.normalizing(mean, std)
    assert (centers[[columns[2] for columns in neighbors.columns]] == mean[first]).all()
    assert not centers[list(neighbors.masks)].any()
    assert (scales[list(neighbors.masks)] == 1).all()


def test_slots_fit_others_in_any_number_and_refuse_other_fields() -> None:
    known = found()
    more = found("coop_nav-n16", "state-7").in_order_of(known)
    assert [kind.n_slots for kind in more.kinds] == [7, 3]
    none = found(observation="state-0").in_order_of(known)
    assert [kind.n_slots for kind in none.kinds] == [0, 3]
    with pytest.raises(SchemaError, match=r"none are missing here, and slots of message are new"):
        found(communication="perfect").in_order_of(known)
    with pytest.raises(SchemaError, match=r"none are missing.*and reference.offset_x"):
        found("formation").in_order_of(known)


def test_features_without_names_are_refused() -> None:
    with pytest.raises(SchemaError, match="policy_network deep_sets needs the names"):
        slots_of((), None)
