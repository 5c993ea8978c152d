"""What an FMU refuses: each is an error status with a message, and the instance goes on.

fmu_refused.py FMU RECORDING FMU-OF-ANOTHER-MACHINE
"""

import shutil
import sys
from ctypes import byref, c_bool, c_double, c_uint, c_uint8, c_void_p
from pathlib import Path

from fmu_run import Fmu, Inputs, Instance, refused

fmu, other = Fmu(sys.argv[1]), Fmu(sys.argv[3])
inputs = Inputs(fmu, sys.argv[2])
channel = fmu.machine["channel"][0]["name"]
load = fmu.machine["load"][0]["name"]
last = len(fmu.references) - 1


def said(instance, *words):
    """The last message has these words."""
    assert instance.messages, words
    assert all(word in instance.messages[-1] for word in words), (instance.messages[-1], words)


# Before the initialisation there are no steps, and no estimate that is valid.
instance = Instance(fmu)
fmi = instance.fmi
refused(instance.step, 0.0)
said(instance, "fmi3DoStep", "before its initialisation")
refused(fmi.exitInitializationMode)
refused(fmi.terminate)
refused(fmi.enterInitializationMode, None, float("nan"))
said(instance, "startTime")
instance.initialise()
assert instance.get()[f"{load}_valid"] is False
refused(fmi.enterInitializationMode, None, 5.0)

# Steps of one sample, one after the other.
for size in (2 * fmu.period, fmu.period / 2, 0.0, -fmu.period, float("nan"), float("inf")):
    refused(fmi.doStep, 0.0, size)
    said(instance, "communicationStepSize", "allowed")
for point in (fmu.period, -1.0, float("nan"), 1e300):
    refused(fmi.doStep, point, fmu.period)

# Value references, types, causalities, numbers.
for reference in (last + 1, 0xFFFFFFFF):
    refused(fmi.getFloat64, [reference])
    refused(fmi.setFloat64, [reference], [0.0])
    refused(fmi.getInt8, [reference])
said(instance, "value reference", f"0 to {last}")
[reading, truth, estimate] = fmu.reference(channel, f"{channel}_delivered", load)
refused(fmi.getInt32, [reading])
refused(fmi.getFloat32, [reading])
said(instance, channel, "Float64")
refused(fmi.setBoolean, [reading], [True])
refused(fmi.setFloat64, [truth], [1.0])
refused(fmi.setString, [reading], ["1"])
refused(fmi.setFloat64, [estimate], [1.0])
said(instance, load, "inputs")
refused(fmi.setFloat64, fmu.reference("time"), [1.0])
for number in (float("nan"), float("inf"), -float("inf")):
    refused(fmi.setFloat64, [reading], [number])
    said(instance, channel, f"{channel}_delivered")
# All or none.
before = fmi.getFloat64([reading])
refused(fmi.setFloat64, [reading, estimate], [1e-5, 1.0])
assert fmi.getFloat64([reading]) == before
# Huge readings are at the end of the converter.
fmi.setFloat64([reading], [1e300])
instance.step(0.0)
assert instance.get()[f"{channel}_fault"] == 3

# Pointers and lengths, past FMPy.
none, references = None, (c_uint * 1)(reading)
values, slot = (c_double * 1)(), c_void_p()
component = fmi.component
refused(fmi.fmi3GetFloat64, component, none, 1, values, 1)
refused(fmi.fmi3GetFloat64, component, references, 1, none, 1)
refused(fmi.fmi3GetFloat64, component, references, 1, values, 2)
refused(fmi.fmi3SetFloat64, component, references, 1, none, 1)
refused(fmi.fmi3GetFloat64, none, references, 1, values, 1)
refused(fmi.fmi3DoStep, component, fmu.period, fmu.period, c_bool(True), none, none, none, none)
refused(fmi.fmi3GetFMUState, component, none)
refused(fmi.fmi3SetFMUState, component, none)
refused(fmi.fmi3SerializedFMUStateSize, component, none, none)
fmi.fmi3FreeFMUState(component, none)
fmi.fmi3FreeFMUState(component, byref(slot))

# States: whole ones of this FMU.
state = instance.saved()
outputs = instance.get()
flipped = bytearray(state)
flipped[len(state) // 2] ^= 1
for wrong in (b"", b"x", state[:-1], state[: len(state) // 2], state + b"\0", bytes(flipped)):
    refused(instance.restore, wrong)
    said(instance, "state")
stranger = other.instance()
refused(instance.restore, stranger.saved())
said(instance, "another model")
handle = fmi.getFMUState()
short = (c_uint8 * 4)()
refused(fmi.fmi3SerializeFMUState, component, handle, short, 4)
refused(fmi.fmi3DeserializeFMUState, component, none, 4, byref(slot))
fmi.freeFMUState(handle)

# What this FMU does not have.
refused(fmi.getDirectionalDerivative, [estimate], [reading], [1.0])
refused(fmi.enterConfigurationMode)
refused(fmi.enterStepMode)
said(instance, "fmi3EnterStepMode")
fmi.setDebugLogging(True, ["logStatusError"])

# After all of this the instance is as it was, and goes on.
assert instance.get() == outputs and instance.saved() == state
instance.step(fmu.period)
fmi.terminate()
refused(instance.step, 2 * fmu.period)

# After a reset it gives what a new one gives.
fmi.reset()
instance.initialise()
new = fmu.instance()
for row in range(200):
    for each in (instance, new):
        inputs.give(each, row)
        each.step(row * fmu.period)
    assert instance.get() == new.get(), row

# Resources that are changed, lost, or no image; the token of another FMU.
for spoil in (
    lambda folder: (folder / "machine.image").unlink(),
    lambda folder: (folder / "machine.image").write_bytes(b"LTMI"),
    lambda folder: (folder / "machine.toml").write_text("format = 2"),
    lambda folder: (folder / "machine.toml").write_bytes(b"\xff"),
    lambda folder: shutil.copy(Path(other.folder, "resources", "machine.image"), folder),
):
    spoilt = Fmu(sys.argv[1])
    spoil(Path(spoilt.folder, "resources"))
    try:
        Instance(spoilt)
    except Exception as error:
        assert "Failed to instantiate" in str(error), error
    else:
        raise AssertionError("no error")
print("refused")
