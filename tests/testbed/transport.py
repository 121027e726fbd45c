"""What carries a client's requests to a coordinator that a test makes up."""

import httpx2

from rehyb.client.wire import SPEAKER


class CoordinatorTransport(httpx2.MockTransport):
    """Has every answer say that it is a coordinator's."""

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        """Return the answer to a request."""
        response = super().handle_request(request)
        response.headers[SPEAKER] = "coordinator"
        return response
