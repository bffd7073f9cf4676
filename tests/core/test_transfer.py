"""Numbers that move between fields and NumPy: in place as through a kernel, of any type, shape and offset."""

from dataclasses import FrozenInstanceError, is_dataclass
from typing import Any

import numpy as np
import pytest

from taichi_erosion.core import transfer
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import field_view

pytestmark = pytest.mark.engine

ROWS = 5


def some_fields() -> dict[str, Any]:
    """Fields that share a block, have one of their own, several axes, ghosts, or are members of a struct."""
    shared: dict[str, Any] = {"whole": ti.field(ti.i32), "place": ti.Vector.field(3, ti.f64)}
    shared["real"] = ti.field(ti.f32)
    ti.root.dense(ti.i, ROWS).place(*shared.values())
    ghosts = ti.field(ti.f64)
    ti.root.dense(ti.ijk, (2, 3, 4)).place(ghosts, offset=(0, -1, -1))
    turn, table = ti.Matrix.field(3, 3, ti.f32, shape=ROWS), ti.Vector.field(3, ti.f32, shape=(2, 3))
    member = ti.types.struct(first=ti.f32, second=ti.f64).field(shape=ROWS).second
    return shared | {"ghosts": ghosts, "turn": turn, "table": table, "member": member}


@transfer.device_record
class Cloud:
    count: int
    position: Any
    charge: Any


def test_a_record_that_kernels_take_is_no_dataclass_and_keeps_its_members():
    cloud = Cloud(2, charge="q", position="x")
    assert not is_dataclass(cloud)
    assert transfer.record_members(Cloud) == transfer.record_members(cloud) == ("count", "position", "charge")
    assert (cloud.count, cloud.position, cloud.charge) == (2, "x", "q")
    assert cloud != Cloud(2, "x", "q")
    with pytest.raises(TypeError):
        Cloud(2, "x")  # pyright: ignore[reportCallIssue]
    with pytest.raises(FrozenInstanceError):
        cloud.count = 3  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("name", ["whole", "place", "real", "ghosts", "turn", "table", "member"])
def test_a_field_lies_in_memory_where_taichi_finds_it(start_device, name):
    start_device(Numerics("cpu", 1))
    fields = some_fields()
    field, view = fields[name], field_view(fields[name])
    number = (7.0 + np.arange(view.size)).reshape(view.shape).astype(view.dtype)
    transfer.write_field(field, number)
    np.testing.assert_array_equal(field.to_numpy(), number)
    field.from_numpy(number + 1)
    np.testing.assert_array_equal(transfer.download_field(field), number + 1)
    # nobody else was written to
    assert not any(transfer.download_field(other).any() for key, other in fields.items() if key != name)


def test_fields_that_are_declared_later_are_found_too(start_device):
    start_device(Numerics("cpu", 1))
    first = ti.field(ti.f64, shape=ROWS)
    transfer.write_field(first, 2.0)
    later = ti.field(ti.i32, shape=ROWS)
    later.from_numpy(np.arange(ROWS, dtype=np.int32))
    assert transfer.download_field(later).tolist() == [0, 1, 2, 3, 4]
    assert transfer.download_field(first).tolist() == [2.0] * ROWS


def test_numbers_move_in_place_as_through_a_kernel(start_device, monkeypatch):
    start_device(Numerics("cpu", 1))
    fields = [field for name, field in some_fields().items() if name not in ("ghosts", "table")]
    # thirds have no exact value in f32, and are cut in i32
    values = [np.linspace(-1.0, 2.0, 3 * field_view(field)[0].size).reshape(3, -1) / 0.3 for field in fields]
    found = []
    for here in (True, False):
        monkeypatch.setattr(transfer, "is_host_memory", lambda here=here: here)
        transfer.upload(list(zip(fields, values, strict=True)), 1)
        found.append(transfer.download(fields, 0, ROWS))
    for in_place, through_kernel in zip(*found, strict=True):
        np.testing.assert_array_equal(in_place, through_kernel)
        assert in_place[1:4].any()
        assert not in_place[0].any()
