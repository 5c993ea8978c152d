"""FMUs in FMPy: an instance of FMI 3.0 or 2.0 by one interface, and the inputs that a recording stands for."""

import math
import tomllib
from pathlib import Path

import fmpy
import numpy as np
import pyarrow.parquet as pq
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.simulation import instantiate_fmu

SI = {"µm/m": 1e6, "mm": 1e3}


class Fmu:
    """An unpacked FMU."""

    def __init__(self, path):
        self.folder = fmpy.extract(path)
        self.description = fmpy.read_model_description(path)
        self.machine = tomllib.loads(Path(self.folder, "resources", "machine.toml").read_text())
        self.period = 1 / self.machine["rate_hz"]
        variables = self.description.modelVariables
        self.references = {v.name: v.valueReference for v in variables}
        self.outputs = [v for v in variables if v.causality == "output"]

    def instance(self, start=0.0):
        """A new one, in step mode."""
        instance = Instance(self)
        instance.initialise(start)
        return instance

    def reference(self, *names):
        """Value references of variables."""
        return [self.references[name] for name in names]


class Instance:
    """One instance."""

    def __init__(self, fmu):
        self.fmu = fmu
        self.is_3 = fmu.description.fmiVersion.startswith("3")
        self.messages = []
        callbacks = {}
        if self.is_3:
            callbacks["logMessage"] = lambda _, status, category, text: self.messages.append(text.decode())
        self.fmi = self.make(callbacks)
        split = lambda kinds: [v for v in fmu.outputs if v.type in kinds]
        self.reals, self.truths = split({"Real", "Float64"}), split({"Boolean"})
        self.integers = split({"Integer", "Int32"})

    def make(self, callbacks):
        """The instance of FMPy, with messages kept."""
        if not self.is_3:
            return instantiate_fmu(self.fmu.folder, self.fmu.description, "CoSimulation")
        description = self.fmu.description
        fmi = FMU3Slave(
            guid=description.guid,
            unzipDirectory=self.fmu.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="test",
        )
        fmi.instantiate(**callbacks)
        return fmi

    def initialise(self, start=0.0):
        """Up to step mode."""
        if self.is_3:
            self.fmi.enterInitializationMode(startTime=start)
        else:
            self.fmi.setupExperiment(startTime=start)
            self.fmi.enterInitializationMode()
        self.fmi.exitInitializationMode()

    def set_reals(self, references, values):
        """Sets real inputs."""
        (self.fmi.setFloat64 if self.is_3 else self.fmi.setReal)(references, values)

    def set_truths(self, references, values):
        """Sets Boolean inputs."""
        self.fmi.setBoolean(references, values)

    def step(self, t):
        """One sample at time `t` (s)."""
        self.fmi.doStep(t, self.fmu.period)

    def get(self):
        """All outputs by name."""
        references = lambda variables: [v.valueReference for v in variables]
        real, integer = (
            (self.fmi.getFloat64, self.fmi.getInt32) if self.is_3 else (self.fmi.getReal, self.fmi.getInteger)
        )
        values = real(references(self.reals)), integer(references(self.integers))
        truths = self.fmi.getBoolean(references(self.truths))
        found = {v.name: value for v, value in zip(self.reals + self.integers, values[0] + values[1])}
        return found | {v.name: bool(value) for v, value in zip(self.truths, truths)}

    def saved(self):
        """The state as bytes."""
        fmi = self.fmi
        state = fmi.getFMUState() if self.is_3 else fmi.getFMUstate()
        data = fmi.serializeFMUState(state) if self.is_3 else fmi.serializeFMUstate(state)
        (fmi.freeFMUState if self.is_3 else fmi.freeFMUstate)(state)
        return data

    def restore(self, data):
        """Goes on from a state."""
        fmi = self.fmi
        state = fmi.deserializeFMUState(data) if self.is_3 else fmi.deSerializeFMUstate(data)
        (fmi.setFMUState if self.is_3 else fmi.setFMUstate)(state)
        (fmi.freeFMUState if self.is_3 else fmi.freeFMUstate)(state)


class Inputs:
    """The inputs of an FMU for each row of a recording in Parquet."""

    def __init__(self, fmu, recording):
        table = pq.read_table(recording)
        self.t = table["t"].to_numpy()
        self.rows = table.num_rows
        reals, truths = {}, {}
        column = lambda name: table[name].to_pandas().to_numpy(dtype=float)
        unit = lambda name: table.schema.field(name).metadata[b"unit"].decode()
        for channel in fmu.machine.get("channel", []):
            name, values = channel["name"], column(channel["name"])
            if unit(name) == "counts" and channel["unit"] != "counts":
                quantiser = channel["quantiser"]
                values = (values - quantiser["zero"]) * quantiser["lsb"]
            self.add(reals, truths, name, values / SI.get(unit(name), 1))
        encoders = fmu.machine.get("encoder", [])
        for encoder in encoders:
            name, values = encoder["name"], column(encoder["name"])
            assert unit(name) == "counts", unit(name)
            self.add(reals, truths, name, values * self.turn(encoder))
        if index := fmu.machine.get("index"):
            pulse, since = index_pulses(column(index["name"]), column(encoders[index["encoder"]]["name"]))
            truths[index["name"]] = pulse
            reals[f"{index['name']}_since"] = since * self.turn(encoders[index["encoder"]])
        self.real_references, self.truth_references = fmu.reference(*reals), fmu.reference(*truths)
        self.reals = np.column_stack(list(reals.values())).tolist()
        self.truths = np.column_stack(list(truths.values())).tolist()

    @staticmethod
    def turn(encoder):
        """Angle of one count (rad); 1 of an encoder in counts."""
        return 1 if encoder["unit"] == "counts" else math.tau / encoder["counter"]["counts_per_turn"]

    @staticmethod
    def add(reals, truths, name, values):
        """A reading; where the recording has none, it is not delivered."""
        reals[name] = np.nan_to_num(values)
        truths[f"{name}_delivered"] = ~np.isnan(values)

    def give(self, instance, row):
        """Sets the inputs of a row."""
        instance.set_reals(self.real_references, self.reals[row])
        instance.set_truths(self.truth_references, self.truths[row])


def index_pulses(latched, counts):
    """Pulses and how far the encoder has turned since [counts], of a column with latched counts."""
    is_pulse = np.zeros(len(latched), bool)
    since = np.zeros(len(latched))
    last = None
    for row, value in enumerate(latched):
        if not np.isnan(value) and value != last:
            is_pulse[row], since[row], last = True, counts[row] - value, value
    return is_pulse, since


def refused(call, *arguments):
    """The error status of a call that must have one."""
    try:
        call(*arguments)
    except FMICallException as error:
        assert error.status == 3, error
        return error
    raise AssertionError(f"{call} {arguments}: no error")
