"""A street in motion: doors, a lift, cars, walking figures, trees in the wind, levels of detail."""

from visref_datasets_gen.busy_street.street import busy_street as busy_street
