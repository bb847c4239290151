"""Path-tracking controllers, a file each behind the protocol of `base`."""

from trackslip.controllers.base import Controller
from trackslip.controllers.feedforward import Feedforward
from trackslip.controllers.linear import LinearTimeVarying

__all__ = ["Controller", "Feedforward", "LinearTimeVarying"]

CONTROLLERS: dict[str, type[Controller]] = {"feedforward": Feedforward, "linear": LinearTimeVarying}
