from . import films as films
from . import gases as gases
