from .config.loading import load_protocol as load_protocol
from .config.loading import load_rig as load_rig
from .files.validation import InvalidInputError as InvalidInputError
from .rig.rig import Rig as Rig
from .session.session import Session as Session
