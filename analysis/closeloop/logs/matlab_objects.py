"""What only MATLAB reads: its objects, and how to save there what they hold."""

#: How to make a structure of an object, by its class.
STRUCTURES = {
    "table": "s = table2struct({0}, 'ToScalar', true)",
    "timetable": "s = table2struct(timetable2table({0}), 'ToScalar', true)",
    "timeseries": "s = struct('t', {0}.Time, 'data', squeeze({0}.Data))",
    "Simulink.SimulationData.Dataset": (
        "s = table2struct(timetable2table(extractTimetable({0})), 'ToScalar', true)"
    ),
}


def of_object(name: str, kind: str) -> str:
    """Say how to save the numbers of an object of a class that only MATLAB reads."""
    how = STRUCTURES.get(kind, "s = struct({0})").format(name)
    return (
        f"{name} is a MATLAB {kind}, an object that only MATLAB reads: save its numbers "
        f"there by {how}; save('log.mat', '-struct', 's')"
    )
