"""Training of the network that corrects the weights of the guard's experts.

    python -m nst_train guard-tables --folder DIR
    python -m nst_train guard --folder DIR --config configs/guard/guard.toml --out FOLDER

`guard_data` makes the pictures in DIR. The first command asks `nst` what the network would read of each, and
stores that beside them, with the errors of any weights as quadratic forms (`table.py`, `forms.py`,
`stored.py`, `make.py`; none of them needs PyTorch). The second one trains (`settings.py`, `data.py`,
`descent.py`), scores on the families that are held out (`scores.py`), and writes the weights.
"""
