from . import fibres as fibres
from . import films as films
from . import gases as gases
