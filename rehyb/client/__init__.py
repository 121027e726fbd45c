"""Talk to a coordinator: plain dictionaries in, plain dictionaries out."""

from rehyb.client.analyses import Analyses
from rehyb.client.close_loops import CloseLoops
from rehyb.client.connection import DEFAULT_URL as DEFAULT_URL
from rehyb.client.connection import Json as Json
from rehyb.client.leases import Leases
from rehyb.client.models import Models
from rehyb.client.sessions import Sessions
from rehyb.client.studies import Studies


class Client(Studies, Models, Leases, Sessions, CloseLoops, Analyses):
    """A connection to one coordinator.

    Args:
        url: where the coordinator listens; default REHYB_URL, else http://127.0.0.1:8787.
        token: the coordinator's token; default REHYB_TOKEN.
        timeout: seconds to wait for one answer.
        transport: for tests: what carries the requests instead of the network.

    Every method raises Unreachable when nothing answers, Unauthorized when the token is refused,
    Invalid when the coordinator cannot use the request, and ServerError when the coordinator fails.

    Raises:
        Unauthorized: there is no token, or one that no request can bear.
    """
