"""The command line: one command, one file of its name."""

COMMANDS = (
    "check",
    "run",
    "score",
    "view",
    "edit",
    "export",
    "retarget",
    "actions",
    "goals",
    "schema",
    "scenes",
    "bake",
    "body",
    "train",
    "bench",
    "help",
)
