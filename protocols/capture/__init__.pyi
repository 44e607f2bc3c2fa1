from .engine import Control as Control
from .engine import Finish as Finish
from .engine import Outcome as Outcome
from .engine import Progress as Progress
from .engine import capture as capture
from .engine import resume as resume
