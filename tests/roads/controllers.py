"""What holds of every assumed program of a place, as SUMO itself reads the network."""

from pathlib import Path

import sumolib.net


def signalised_junctions(path: Path) -> int:
    """Check that a junction has one controller, of 120 s at most; return how many have one.

    A junction is a node of the network: consolidated ones hold all nodes of the map within them.
    """
    net = sumolib.net.readNet(str(path), withPrograms=True, withPedestrianConnections=True)
    controllers = [
        {item.getTLSID() for item in node.getConnections() if item.getTLSID()}
        for node in net.getNodes()
    ]
    assert all(len(found) <= 1 for found in controllers)
    for light in net.getTrafficLights():
        for program in light.getPrograms().values():
            cycle_s = sum(phase.duration for phase in program.getPhases())
            assert 0 < cycle_s <= 120, light.getID()
    return sum(map(len, controllers))
