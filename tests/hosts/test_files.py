"""The committed description files, read by the tools that people use: lely's dcfchk, python canopen, cantools."""

import configparser
import logging
import pathlib
import subprocess
import sys
import warnings

import canopen
import cantools
import pytest

DOCS = pathlib.Path(__file__).parents[2] / "docs"
EDS = DOCS / "edm-servo-head.eds"
DBC = DOCS / "edm-servo-head.dbc"
# The DBC is that of this node.
NODE = 1
READ = {"ro", "rw", "rwr", "rww", "const"}
INVALID = 1 << 31


@pytest.fixture(scope="module")
def objects():
    return canopen.import_od(str(EDS), NODE)


@pytest.fixture(scope="module")
def frames():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return cantools.database.load_file(DBC, strict=True)


def values(objects):
    """Every value: an object without sub-indices, or each of its sub-indices."""
    for thing in objects.values():
        yield from thing.values() if hasattr(thing, "subindices") else [thing]


def test_lely_finds_nothing_wrong_with_the_data_sheet():
    dcfchk = pathlib.Path(sys.executable).with_name("dcfchk")
    # The highest node-ID has to do as well.
    for node in ("1", "32", "127"):
        run = subprocess.run([dcfchk, "-n", node, EDS], capture_output=True, text=True, check=False)
        assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def test_lely_would_have_found_something(tmp_path):
    dcfchk = pathlib.Path(sys.executable).with_name("dcfchk")
    wrong = tmp_path / "wrong.eds"
    wrong.write_text(EDS.read_text().replace("HighLimit=1\n", "HighLimit=-1\n", 1))
    assert subprocess.run([dcfchk, "-n", "32", wrong], capture_output=True, check=False).returncode != 0


def test_canopen_loads_every_object_of_the_data_sheet(caplog):
    with caplog.at_level(logging.WARNING):
        objects = canopen.import_od(str(EDS), NODE)
    assert caplog.records == []
    sheet = configparser.RawConfigParser()
    sheet.read(EDS)
    listed = [
        int(index, 16)
        for section in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
        for key, index in sheet[section].items()
        if key.isdigit()
    ]
    dummies = [index for index in objects if index < 0x1000]
    assert sorted(listed + dummies) == sorted(objects)
    # Every section with a type is a value that canopen has.
    addresses = {(value.index, value.subindex) for value in values(objects) if value.index >= 0x1000}
    typed = {
        (int(name[:4], 16), int(name[7:] or "0", 16))
        for name in sheet.sections()
        if sheet.has_option(name, "DataType")
    }
    assert addresses == typed
    assert len(typed) > 300


def test_defaults_lie_within_their_limits(objects):
    limited = [value for value in values(objects) if value.min is not None]
    assert len(limited) > 100
    for value in limited:
        assert value.min <= value.max, value.name
        if isinstance(value.default, int) and value.access_type in READ | {"wo"}:
            assert value.min <= value.default <= value.max, value.name


def test_names_tell_the_values_of_a_record_apart(objects):
    for thing in objects.values():
        if hasattr(thing, "subindices"):
            names = [value.name for value in thing.values()]
            assert len(set(names)) == len(names), thing.name
    names = [thing.name for thing in objects.values()]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("kind", ["RPDO", "TPDO"])
def test_a_pdo_is_the_same_in_both_files(objects, frames, kind, number):
    communication, mapping = (0x1400, 0x1600) if kind == "RPDO" else (0x1800, 0x1A00)
    cob = objects[communication + number][1].default
    entries = objects[mapping + number]
    mapped = [entries[sub].default for sub in range(1, entries[0].default + 1)]
    frame = frames.get_message_by_frame_id(cob & 0x7FF)
    assert frame.name == f"{kind}{number + 1}_{NODE}"
    start = 0
    for entry, signal in zip(mapped, sorted(frame.signals, key=lambda signal: signal.start), strict=True):
        index, sub, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        thing = objects[index]
        value = thing[sub] if hasattr(thing, "subindices") else thing
        assert value.pdo_mappable
        assert value.access_type in ({"rw", "rww", "wo"} if kind == "RPDO" else {"ro", "rw", "rwr", "const"})
        assert len(value) == bits
        assert (signal.start, signal.length) == (start, bits)
        assert signal.is_signed == (value.data_type in canopen.objectdictionary.SIGNED_TYPES)
        start += bits
    assert frame.length * 8 == start
    # Those the drive profile asks for are in use from the start.
    assert (cob & INVALID == 0) == (number < 3)


def test_frames_decode_to_units_and_words(frames):
    live = frames.decode_message(0x381, bytes.fromhex("9cffffff 7017 08 0b"))
    assert live["PathQueueSignedFeed"] == -100
    assert live["GapVoltage"] == pytest.approx(60.0)
    assert frames.get_message_by_frame_id(0x381).get_signal_by_name("GapVoltage").unit == "V"
    assert str(live["HeadReason"]) == "fault"
    assert isinstance(live["HeadState"], cantools.database.namedsignalvalue.NamedSignalValue)
    status = frames.decode_message(0x181, bytes.fromhex("370608 0c 03"))
    assert (status["Statusword"], str(status["ModesOfOperationDisplay"])) == (0x0637, "cyclic synchronous position")
    assert (status["HeadRefusal"], status["HeadRefusals"]) == (12, 3)
    assert str(frames.decode_message(0x701, b"\x05")["NmtState"]) == "operational"
    trouble = frames.decode_message(0x081, bytes.fromhex("118621 0a00000000"))
    assert (trouble["ErrorCode"], trouble["ErrorRegister"]) == (0x8611, 0x21)
    answer = frames.decode_message(0x581, bytes.fromhex("4364600010270000"))
    assert (answer["SdoIndex"], answer["SdoSubIndex"], answer["SdoData"]) == (0x6064, 0, 10_000)


def test_frames_encode_for_the_head(frames):
    assert frames.encode_message("NMT", {"NmtCommand": "start", "NmtNode": NODE}) == bytes([1, NODE])
    assert frames.encode_message("RPDO2_1", {"TargetPosition": -2}) == bytes.fromhex("feffffff")
    assert frames.encode_message("SYNC", {}) == b""
