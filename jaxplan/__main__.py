"""The command line as ``python -m jaxplan``."""

import sys

from jaxplan.cli import main

sys.exit(main())
