"""``python -m posing`` runs the program, with its arguments and exit code."""

import subprocess
import sys

from posing import program

sys.exit(subprocess.call([program(), *sys.argv[1:]]))
