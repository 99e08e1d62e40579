"""The codes of all problems that are reported: which places and classes of errors they stand for, cause and cure.

An error gets its code by the place that makes it (`room.module:function`) and by its class. An entry for a class alone
wins; then the longest place, and among equal places the entry that names the class. So a new message in a known module
has a code at once.
`st-codegen explain CODE` shows an entry, and the site has all of them on one page.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

#: The rank of an entry for a class of errors wherever they are made: above all places.
_ANY_PLACE = 1000
#: What an error has that no entry stands for; a test finds no place in the package that makes one.
UNKNOWN = "STC1000"


@dataclass(frozen=True)
class Diagnostic:
    """One code: title, cause and cure; `places` (`room`, `room.module` or `room.module:function`) and error `kinds`."""

    code: str
    title: str
    cause: str
    cure: str
    places: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()

    def text(self) -> str:
        """The entry as plain text."""
        return f"{self.code}: {self.title}\n\nCause: {self.cause}\n\nWhat to do: {self.cure}"

    def rank(self, place: str, kinds: frozenset[str]) -> tuple[int, bool] | None:
        """How well this entry fits an error made at a place; None: not at all."""
        if self.kinds and kinds.isdisjoint(self.kinds):
            return None
        fitting = [len(own) for own in self.places if f"{place}.".startswith((f"{own}.", f"{own}:"))]
        if fitting:
            return max(fitting), bool(self.kinds)
        return (_ANY_PLACE, True) if self.kinds and not self.places else None


def code_for(place: str, kinds: Iterable[str]) -> str:
    """The code of an error that is made at a place; `kinds`: the names of its class and of those above it."""
    names = frozenset(kinds)
    ranked = [(rank, entry.code) for entry in DIAGNOSTICS if (rank := entry.rank(place, names)) is not None]
    return max(ranked, key=lambda pair: pair[0])[1] if ranked else UNKNOWN


def diagnostic(code: str) -> Diagnostic | None:
    """The entry of a code, or None."""
    return next((entry for entry in DIAGNOSTICS if entry.code == code.upper()), None)


_READ_LIMITS = "See the page on cost for the limits of each target, and on security for those of model files."
DIAGNOSTICS = (
    Diagnostic(
        UNKNOWN,
        "An input cannot be used",
        "Something that was given to the program cannot be used. The message says what.",
        "Follow the message. If it does not help, please report it: a confusing message is a defect.",
    ),
    # --- use of the command line, the machine
    Diagnostic(
        "STC1001",
        "The command line is not used as it is meant",
        "An option or an argument is unknown, missing, or has a value that is not allowed.",
        "Run the command with --help: it lists all options with examples.",
        kinds=("UsageError", "ClickException"),
    ),
    Diagnostic(
        "STC1002",
        "The system refuses a file or folder",
        "The operating system does not let the program read or write: no permission, a full disk, a broken link.",
        "Look at the path and the reason in the message, and give the program a place where it may write.",
        kinds=("OSError",),
    ),
    Diagnostic(
        "STC1003",
        "A text cannot be read",
        "A file is not UTF-8 text, or a table in it is broken (quotes that do not end, for example).",
        "Save the file again as UTF-8. In a table, give each line the same number of cells.",
        kinds=("UnicodeError", "csv.Error"),
    ),
    Diagnostic(
        "STC1004",
        "The input is too deep or too large for this machine",
        "Something in the input is nested too deeply, or needs more memory than there is.",
        "Use a smaller model, or a machine with more memory.",
        kinds=("RecursionError", "MemoryError"),
    ),
    Diagnostic(
        "STC1005",
        "A package is not installed, too old, or broken",
        "A part of the program needs a library that is not installed, that cannot be imported, or whose rules in this "
        "version are not known.",
        'Install the extra that the message names, for example pip install "st-codegen[lightgbm]". st-codegen doctor '
        "shows what is there and what is missing.",
        kinds=("MissingExtraError",),
    ),
    Diagnostic(
        "STC1006",
        "What the command should write is there already",
        "`init` does not overwrite a configuration that somebody may have completed by hand.",
        "Keep what is there, or pass --force to replace it.",
        places=("cli.init",),
    ),
    # --- files and folders
    Diagnostic(
        "STC1101",
        "A file or folder is not there, or is something else",
        "The path does not exist, or there is a folder where a file is wanted, or the other way round.",
        "Check the spelling of the path and the folder that you run the command in.",
        places=("files.text", "st.syntax.source", "walkers.files"),
    ),
    Diagnostic(
        "STC1104",
        "A text is not UTF-8",
        "The file has another encoding, such as UTF-16 or Latin-1. The message has the first byte that does not fit.",
        "Save the file again as UTF-8; editors and spreadsheet programs offer this when they save.",
        places=("files.text:_decoded",),
    ),
    Diagnostic(
        "STC1102",
        "A file or folder cannot be written",
        "Where the result should go there is something else, such as a file in place of a folder.",
        "Give another place with --out, or remove what is in the way. Files that it did not write stay, but in "
        "the folders that fleet keeps for each axis.",
        places=("files.folders", "files.text:make_folder", "files.text:whole_file", "emit.output"),
    ),
    Diagnostic(
        "STC1103",
        "A generated file was changed by hand",
        "A file that would be overwritten has changes that the program did not make. They would be lost.",
        "Move your changes out of the generated file, or give --force to overwrite them.",
        places=("emit.output:_refuse_to_lose_changes",),
    ),
    # --- model files
    Diagnostic(
        "STC1201",
        "This kind of model is not supported",
        "The file holds a class, an operator or an option that cannot be written as Structured Text here.",
        "st-codegen models lists what is supported. The message names what is near: often another class of the same "
        "library, or another option of the same class, gives nearly the same model.",
        places=("walkers", "beckhoff_ml.model"),
        kinds=("UnsupportedModelError",),
    ),
    Diagnostic(
        "STC1202",
        "A model file cannot be read",
        "The file is damaged, was cut off, or its content contradicts itself.",
        "Save the model again with the library that trained it. If the library itself can load the file, please "
        "report this.",
        places=("walkers", "walkers.files:_check_beginning", "ir", "beckhoff_ml.file", "beckhoff_ml.model"),
    ),
    Diagnostic(
        "STC1203",
        "Loading this file could run code",
        "A pickle, or a type in a .skops file, can run any code of its author when it is loaded.",
        "Save the model as .skops, .onnx or in its library's own format. For files of your own there is "
        "--trust-pickle.",
        kinds=("UntrustedFileError",),
    ),
    Diagnostic(
        "STC1204",
        "A file is larger than the limit",
        "What a model file holds is more than the program reads, to keep the memory of your machine in bounds.",
        f"If you trust the file, raise the limit with --max-model-bytes. {_READ_LIMITS}",
        places=("walkers.limits",),
    ),
    Diagnostic(
        "STC1205",
        "A model is not as its library makes it",
        "The model was not fitted, or was changed after it was fitted, or has numbers that are not finite.",
        "Call fit() before you save the model, and do not change its attributes afterwards.",
        places=("walkers.fitted", "walkers.sklearn.estimator"),
    ),
    Diagnostic(
        "STC1206",
        "The library refuses the model",
        "The library of the model gives an error where it should predict. So there is nothing to compare with.",
        "Load the model in Python and call predict: you should see the same error. Save the model again with this "
        "version of the library.",
        kinds=("LibraryRefusesError",),
    ),
    Diagnostic(
        "STC1207",
        "A result could be larger than any number",
        "For inputs within the declared range the arithmetic of the model could overflow, which would stop a "
        "controller.",
        "Give the inputs a smaller range, or scale them before training.",
        places=("passes.domain",),
    ),
    Diagnostic(
        "STC1411",
        "REAL cannot stand for LREAL here",
        "--real asks for text without LREAL. The target's controllers have LREAL, or the model has a step of which no "
        "bound in REAL is derived.",
        "The message has the reason. The page on targets lists what is written in REAL, for iec, plcopen and codesys, "
        "and says what is lost.",
        places=("passes.real", "project.bundle:load", "driver:_check_real"),
    ),
    Diagnostic(
        "STC1208",
        "A model does not give what is asked for",
        "--outputs asks for probabilities or scores that this class does not have, or names a model that is not there.",
        "Ask for what the message lists. --outputs asks every model of a folder, for probability and decision every "
        "classifier; the key gives of a [[model]] table in st-codegen.toml asks one model.",
        places=("passes.outputs", "project.bundle:_check_gives"),
    ),
    Diagnostic(
        "STC1209",
        "The format of a file is not known",
        "The ending of the file's name is none of those that models have.",
        "Save the model in one of the formats that the message lists.",
        places=("walkers.files",),
        kinds=("UnsupportedModelError",),
    ),
    # --- names and configuration
    Diagnostic(
        "STC1301",
        "A name cannot be used in Structured Text",
        "The name of a model, feature or output has letters that the language does not allow, is a reserved word, is "
        "too long, or is taken by something else.",
        "Rename it, or give it another name in st-codegen.toml: st-codegen init writes a first one.",
        places=(
            "emit.literals",
            "emit.blocks.model",
            "emit.blocks.application:Application",
            "emit.foreign_names",
            "emit.contents",
            "project.bundle:check_names",
        ),
    ),
    Diagnostic(
        "STC1302",
        "The configuration st-codegen.toml has a fault",
        "A key is unknown, a value has the wrong type, or two entries contradict each other.",
        "The message names the table and the key, and the nearest known key. All keys are on the page on "
        "configuration.",
        places=("project.configuration",),
    ),
    Diagnostic(
        "STC1306",
        "What is said of inputs or outputs does not fit the model",
        "A range is empty or has one end only, or another number of outputs is described than the model has.",
        "Correct the entry in st-codegen.toml or bundle.toml; st-codegen init shows what the model has.",
        places=(
            "ir.model:Feature",
            "ir.model:Output",
            "ir.model:ModelIR.__post_init__",
            "ir.model:ModelIR._check_ports",
        ),
    ),
    Diagnostic(
        "STC1307",
        "There is no folder of models",
        "The folder is not there, has no model files that leave_out of st-codegen.toml leaves, or is described twice "
        "(by bundle.toml and by st-codegen.toml).",
        "Check the path. The message lists the endings of files that are models.",
        places=("project.bundle:_loaded", "project.bundle:_model_files", "project.initial"),
    ),
    Diagnostic(
        "STC1308",
        "A table of training data does not fit the models",
        "The table has no rows, lacks a column that a model has, or reaches less far than the data that a model's file "
        "says it was trained with.",
        "Give the table that the models were trained with, with the names of their inputs as its header.",
        places=("project.initial:_check_trained_with",),
    ),
    Diagnostic(
        "STC1303",
        "A bundle of models has a fault",
        "bundle.toml names files that are not there, or lacks orders, directions or features.",
        "The page on bundles shows a complete file. st-codegen train writes one.",
        places=("te", "project"),
    ),
    Diagnostic(
        "STC1304",
        "A rig model has a fault",
        "rig.toml has an unknown effect or key, or a value outside of its bounds.",
        "The page on effects lists all effects with their keys, units and bounds; examples/rv160n/rig.toml is "
        "complete.",
        places=("rig.model", "rig.effects", "rig.axis", "rig.axis_parameters", "rig.tasks", "rig.machine"),
    ),
    Diagnostic(
        "STC1305",
        "A profile or its measured times cannot be used",
        "A profile lacks a cost, or the table of measured times does not fit the generated code.",
        "Copy profiles/cx5140.toml and change its numbers. calibrate --help shows the form of the table.",
        places=("cost", "cli.calibrate"),
    ),
    # --- targets and sizes
    Diagnostic(
        "STC1401",
        "The target cannot hold this model",
        "The model is valid, but the format of the target has no way to say it.",
        "Use another target, or train another kind of model. The page on targets says what each can hold.",
        places=("beckhoff_ml", "emit.targets", "emit.blocks.trees", "emit.blocks.listing:Listing.constant"),
    ),
    Diagnostic(
        "STC1402",
        "The code is larger than the target's limit",
        "An array, or all tables together, would be larger than the limit of the target.",
        "Train a smaller model (fewer trees, fewer leaves), use --layout trees, or raise --max-array or --max-bytes. "
        f"{_READ_LIMITS}",
        places=("emit.blocks", "driver:_check_size", "passes"),
    ),
    Diagnostic(
        "STC1403",
        "These options do not go together",
        "An option has no meaning for this target, or without another option.",
        "The message names what goes with what; st-codegen generate --help has examples.",
        places=("driver", "cli", "emit.targets.base", "emit.blocks.application"),
    ),
    # --- generated code
    Diagnostic(
        "STC1501",
        "There is no generated code for this model",
        "The folder has no generated files, or they were made from other models, by another version, or without "
        "--with-comparison where a controller is asked.",
        "Generate again: st-codegen MODELS --out FOLDER, then give the same FOLDER with --generated.",
        places=("emit.output", "proof", "reconcile.models", "rig.compensator", "live"),
        kinds=("GeneratedCodeError",),
    ),
    Diagnostic(
        "STC1502",
        "A text is not valid Structured Text",
        "The text does not follow the grammar, or a name or a type in it is wrong. The message has file, line "
        "and column.",
        "If the text was changed by hand, generate again. If st-codegen wrote it, please report it.",
        kinds=("StError", "_InvalidTextError"),
    ),
    Diagnostic(
        "STC1503",
        "The text would stop a controller",
        "While the text was run, something happened that stops a real controller: a division by zero, an index out of "
        "range, an overflow, or a loop without end.",
        "If the text was changed by hand, look at the line in the message. If st-codegen wrote it, please report it.",
        kinds=("StRuntimeError", "_StopsError"),
    ),
    Diagnostic(
        "STC1504",
        "The engine was asked for something that a project does not have",
        "A block, a variable or a dialect is not there.",
        "Check the name; names of blocks and variables are those of the text.",
        places=("st",),
    ),
    # --- data
    Diagnostic(
        "STC1601",
        "A measured curve or a table of harmonics cannot be used",
        "A file of a campaign lacks columns or samples, has numbers that are not finite, or does not say its "
        "conditions; or a table lacks an order that is asked for.",
        "The message says where. --skip-bad leaves bad files out. The page on training shows the form.",
        places=("campaign",),
    ),
    Diagnostic(
        "STC1602",
        "A table of inputs cannot be used",
        "The table lacks a column that the model needs, or has a cell that is no number.",
        "The first line must name the features as the model calls them (f0, f1, .. where it has no names).",
        places=("proof.predict",),
    ),
    Diagnostic(
        "STC1603",
        "Training cannot start or go on",
        "Orders, families or folds do not fit the data, kept work is of another run, or the scheduler of a cluster "
        "does not answer.",
        "Follow the message; st-codegen train --help has examples.",
        places=("training", "cli.train", "cli.training", "cli.tables"),
    ),
    Diagnostic(
        "STC1604",
        "A motion or a campaign cannot be simulated",
        "The profile, the conditions, the tasks or the inputs of the compensator do not fit the rig.",
        "Follow the message; the page on motions explains rig, profiles and tasks.",
        places=("rig", "te.latency"),
    ),
    Diagnostic(
        "STC1605",
        "Measured data cannot be compared with the rig, or tell nothing of a joint",
        "The data lack conditions or columns, nothing in them can be compared with the rig model, no joint moves in "
        "them, or they look measured or labelled in a way that has to be answered first.",
        "Where the message names --accept or --scale, answer with it. The pages on reconcile and on joints say which "
        "forms of data are read, and what is asked.",
        places=("reconcile", "cli.reconcile"),
    ),
    Diagnostic(
        "STC1608",
        "A fleet cannot be done",
        "fleet.toml has unknown keys, names that are no folders, or campaigns and rigs that are not there; or the "
        "folder of results holds something else.",
        "The message lists the problems. The page on fleets has an example.",
        places=("fleet",),
    ),
    Diagnostic(
        "STC1606",
        "Two revisions cannot be compared",
        "Git is not installed, or does not know the revision or the path.",
        "Run the command in the repository, or give two folders.",
        places=("cli.revisions",),
    ),
    Diagnostic(
        "STC1701",
        "The controller does not answer as expected",
        "The connection to a controller, or what it answers, is not what the program expects.",
        "Check address, route and port, and that the controller runs the generated project in its present form.",
        places=("live",),
    ),
    Diagnostic(
        "STC1711",
        "The address of the controller is not one",
        "--ads takes NETID:PORT or NETID:PORT@HOST[:TCPPORT], --opcua a URL, and one of the two must be there.",
        "Such as --ads 192.168.0.5.1.1:851 or --opcua opc.tcp://192.168.0.5:4840/.",
        places=(
            "live.controller:AdsController.__init__",
            "live.controller:OpcUaController",
            "live.controller:connected",
        ),
    ),
    Diagnostic(
        "STC1712",
        "The folder cannot take this campaign",
        "The folder of record holds something else, or was begun with another plan.",
        "Name a new folder, or give the plan that the folder was begun with.",
        places=("live.record:open_campaign",),
    ),
    Diagnostic(
        "STC1714",
        "A measurement that FB_Experiment does not make",
        "The plan has operating points, or --set has settings, beyond the limits of FB_Experiment or without a place "
        "there; or more samples are wanted than a revolution has cycles.",
        "The message has the limits. Change the plan, the setting or --samples.",
        places=("live.record:_check_plan",),
    ),
    Diagnostic(
        "STC1713",
        "The soft PLC cannot start",
        "The generated folder has no program or nothing that a rig could be connected to, or the address is taken "
        "or none of this machine.",
        "Generate with --with-comparison, or a bundle; name another port with --ads-port or --opcua-port, or another "
        "address with --listen.",
        places=("live.serve", "live.plc", "live.plant", "cli.serve"),
    ),
    Diagnostic(
        "STC1702",
        "The controller cannot be reached",
        "Nothing listens at the address: it is wrong, the controller is off, or a firewall is in between.",
        "Check host and TCP port (48898 for ADS, mostly 4840 for OPC UA). The message has the ones that were tried.",
        kinds=("UnreachableError",),
    ),
    Diagnostic(
        "STC1703",
        "There is no PLC at the AMS port",
        "A router answers, but no PLC behind the port: the port is another one, TwinCAT is in CONFIG, or the "
        "controller has no route back to this machine.",
        "The first PLC project of TwinCAT 3 has port 851, the second 852. Start the runtime, and add a route.",
        kinds=("NoPlcError",),
    ),
    Diagnostic(
        "STC1704",
        "The controller does not answer in time",
        "The connection was lost, the controller is too busy, or a task is not started. An axis that a lost client has "
        "set in motion is stopped by the controller itself, after --alive seconds.",
        "Check the network and the load of the controller; --timeout gives it more time. The same command of record "
        "goes on with what is missing.",
        kinds=("SilentError",),
    ),
    Diagnostic(
        "STC1705",
        "The PLC is not in RUN",
        "The PLC is in CONFIG or STOP, or an error has stopped it.",
        "Look at its log, bring it to RUN, then repeat the command.",
        kinds=("NotRunningError",),
    ),
    Diagnostic(
        "STC1706",
        "The controller has no such variable",
        "Another project runs there, one that was generated without --with-comparison, or one whose variables are not "
        "published (OPC UA).",
        "Generate with --with-comparison, download, start, and name the same folder with --generated.",
        kinds=("UnknownVariableError",),
    ),
    Diagnostic(
        "STC1707",
        "A variable of the controller may not be written",
        "The server refuses writes to a variable that is no input.",
        "Let clients of OPC UA write GVL_Comparison, GVL_Record and GVL_Experiment. serve lets them write inputs only.",
        kinds=("NotWritableError",),
    ),
    Diagnostic(
        "STC1708",
        "The controller runs another project",
        "The fingerprint of the project on the controller is not that of the generated folder: another version was "
        "downloaded, or the folder was generated again since.",
        "Download the folder, or name the folder that was downloaded with --generated.",
        kinds=("OtherProjectError",),
    ),
    Diagnostic(
        "STC1709",
        "Another client uses the controller",
        "Another client compares or measures. One at a time can.",
        "Wait for it, or end it. A client that has died is forgotten after its --alive seconds.",
        kinds=("OtherClientError",),
    ),
    Diagnostic(
        "STC1715",
        "The controller corrects the axis that is to be measured",
        "bEnable or bActive of GVL_Machine is TRUE. FB_Experiment takes over the motor's reference, and a correction "
        "that is left out at once is a step.",
        "Write FALSE to GVL_Machine.bEnable, wait until GVL_Machine.bActive is FALSE, then repeat the command.",
        kinds=("CorrectionError",),
    ),
    Diagnostic(
        "STC1710",
        "A measurement ended early",
        "FB_Experiment has reported an error, such as a speed, torque or temperature out of its limits; samples were "
        "lost; or they are no numbers. The axis was stopped first, and finished measurements are kept.",
        "The message has the reason. Remove it, then give the same command again: it goes on with what is missing.",
        kinds=("MeasurementError",),
    ),
    Diagnostic(
        "STC1607",
        "A bad row in a table",
        "A row of a table has too few cells, or a cell that is no number.",
        "The message has the line. Correct or remove it.",
        kinds=("RowError",),
    ),
    # --- answers that are no
    Diagnostic(
        "STC2001",
        "The numbers differ",
        "For at least one input, library, reference and generated text give different results, by more than is "
        "allowed.",
        "If a generated file was changed by hand, or the model is newer than the code: generate again. Otherwise "
        "please report it, with the input that the message names.",
    ),
    Diagnostic(
        "STC2003",
        "The controller computes something else",
        "For at least one row the controller's answer is not the library's within the derived bound, or its bits are "
        "not those of the same text run here although nothing in the text leaves them open.",
        "The message names model or block, row and inputs. Download the generated project again; if it stays, compare "
        "the constants of that block on the controller with the generated file.",
    ),
    Diagnostic(
        "STC2002",
        "The worst case does not fit into the cycle",
        "The estimated worst case of a cycle is longer than --cycle-us, or has no bound.",
        "The table says who spends what. Use a smaller model, a larger --table-limit, --relayout over files that are "
        "there, --outputs-per-cycle for a bundle, or a longer cycle.",
    ),
    Diagnostic(
        "STC2004",
        "Nothing was compared",
        "To none of the rows that were tried the model has an answer: a number leaves the domain of a function, as the "
        "root of a number below 0 does. Where nobody declares ranges, rows lie where the numbers of the model suggest.",
        "Declare the ranges of the inputs in st-codegen.toml (st-codegen init writes a first one), and verify again.",
    ),
    Diagnostic(
        "STC2101",
        "A model is refuted",
        "There is an input for which the executed text gives another result than the model demands. The message "
        "names it.",
        "If a generated file was changed by hand, generate again. Otherwise please report it.",
    ),
    Diagnostic(
        "STC2102",
        "A model is not proved",
        "The proof does not follow something in this model, and the message says what. The text may be right.",
        "Use st-codegen verify, which tries a sample. The page on the proof lists what is not followed.",
    ),
    Diagnostic(
        "STC2201",
        "The generated files are not up to date",
        "The models, the options or the version of st-codegen have changed since the files were written.",
        "Generate again, look at the difference, and commit it. --stat shows a line for each file.",
    ),
    Diagnostic(
        "STC9001",
        "A defect of st-codegen",
        "Something happened that should not happen, whatever was given to the program.",
        "Please report it with the command, the input and what --traceback shows.",
    ),
)
