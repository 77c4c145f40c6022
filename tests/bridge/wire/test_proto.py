"""The committed protobuf modules are what the .proto files generate, and the twins are the same message."""

import subprocess
import sys
from pathlib import Path

import pytest
from google.protobuf.descriptor import Descriptor, FieldDescriptor

from bridge.wire import columns_pb2, truerate_pb2

ROOT = Path(__file__).parents[3]
WIRE = ROOT / "bridge" / "wire"


def test_the_committed_modules_match_a_regeneration(tmp_path: Path) -> None:
    sources = ["bridge/wire/truerate.proto", "bridge/wire/columns.proto"]
    command = [
        sys.executable,
        "-m",
        "grpc_tools.protoc",
        "-I",
        ".",
        f"--python_out={tmp_path}",
        f"--pyi_out={tmp_path}",
    ]
    subprocess.run([*command, *sources], cwd=ROOT, check=True, timeout=60)
    for made in sorted((tmp_path / "bridge" / "wire").iterdir()):
        assert made.read_text() == (WIRE / made.name).read_text(), f"{made.name} is out of date: run `make proto`"


def _columns(twin: Descriptor) -> list[str]:
    return [field.name for field in twin.fields if field.type == FieldDescriptor.TYPE_BYTES]


@pytest.mark.parametrize("name", ["SampleBatch", "CorrectedBatch", "OrientationBatch", "WindowBatch"])
def test_a_twin_has_the_same_fields_under_the_same_numbers(name: str) -> None:
    real: Descriptor = truerate_pb2.DESCRIPTOR.message_types_by_name[name]
    twin: Descriptor = columns_pb2.DESCRIPTOR.message_types_by_name[name]
    assert {f.name: f.number for f in real.fields} == {f.name: f.number for f in twin.fields}
    for field in real.fields:
        other = twin.fields_by_name[field.name]
        if field.is_repeated:
            assert field.is_packed
            assert other.type == FieldDescriptor.TYPE_BYTES
        elif field.type == FieldDescriptor.TYPE_ENUM:
            assert other.type == FieldDescriptor.TYPE_UINT32
        else:
            assert other.type == field.type


def test_every_enum_equals_the_programs_own() -> None:
    from bridge.wire import messages

    for enum in truerate_pb2.DESCRIPTOR.enum_types_by_name.values():
        own = getattr(messages, enum.name)
        assert sorted(value.number for value in enum.values) == sorted(int(m) for m in own.__members__.values())
