"""The same as `python -m nst_train guard-data`, without PyTorch."""

import sys

from nst_train.guard_data.command import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
