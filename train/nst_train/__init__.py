"""Training for `nst`: networks that transform a sequence of Monte Carlo estimates into better ones.

Mukherjee et al., "Neural Sequence Transformation", Pacific Graphics 2021. Equation numbers in this
package are that paper's.
"""
