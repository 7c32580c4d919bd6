"""Where queues begin: on networks whose narrow place is known."""

from collections.abc import Callable
from pathlib import Path

import pytest

from urbantwin.roads.sumo_network import read_sumo_network
from urbantwin.traffic.flow.bottleneck import Bottleneck, bottleneck

#: Three streets one after the other, a signal with a short green at the end of the second.
NODES = """<node id="a" x="-300" y="0"/><node id="b" x="-150" y="0"/>
<node id="c" x="0" y="0" type="traffic_light"/><node id="d" x="150" y="0"/>
<node id="n" x="0" y="100"/><node id="s" x="0" y="-100"/>"""
EDGES = """<edge id="ab" from="a" to="b" numLanes="1" name="First"/>
<edge id="bc" from="b" to="c" numLanes="1" name="Second"/>
<edge id="cd" from="c" to="d" numLanes="1" name="Third"/>
<edge id="nc" from="n" to="c" numLanes="1"/><edge id="cs" from="c" to="s" numLanes="1"/>"""


@pytest.fixture(scope="module")
def network(make_net: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory):
    net = make_net(tmp_path_factory.mktemp("chain"), NODES, EDGES, "--output.street-names", "true")
    return read_sumo_network(net, driving_side="right", level_of_way={}, origin={})


def test_a_queue_is_followed_to_the_signal_that_it_begins_at(network) -> None:
    # 15 vehicles of the 20 that have room stand on either street all the time.
    told = bottleneck(network, {"ab_0": 15.0, "bc_0": 14.0, "nc_0": 1.0}).because
    assert told.startswith(
        "the queue on Second from the west begins at a signal that is green for "
    )
    (program,) = network.programs
    assert told.endswith(f"of {sum(seconds for seconds, _ in program.phases):.0f} s")


def test_a_queue_without_another_ahead_begins_where_it_stands(network) -> None:
    told = bottleneck(network, {"ab_0": 15.0, "bc_0": 0.1}).because
    assert told == "the queue on First from the west begins where it gives way"


def test_without_queues_there_is_nothing_to_say(network) -> None:
    assert bottleneck(network, {}) == Bottleneck()
