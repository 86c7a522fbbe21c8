"""The bifurcation domain of the diamond: where loading programmes lose stability in (s1, s2).

From the virgin loop, a fan of straight strain programmes `E' = (cos b, sin b)`; on each the first
state where `det Ks = 0` and where `det K = 0`, with contacts that always stick and with friction.
"""

from studies.domain.losses import DomainParameters as DomainParameters
from studies.domain.run import run_domain as run_domain
