"""Pictures to train a network on that weighs the guard's experts.

    python -m nst_train guard-data --folder DIR

Random scenes of all branches of `random_scenes`, rendered by the `nst` binary: sequences in folds with
features at 8 to 1024 samples per pixel, and two independent halves of a reference. `plan.py` says what each
scene gets, `make.py` makes it, `read.py` is for whoever trains. None of them needs PyTorch.
"""
