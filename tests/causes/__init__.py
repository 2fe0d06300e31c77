"""How well causes are named: every fault of the suite that loses objects, with the causes that
would be right for it, and the table of what was said (`python -m tests.causes.table`).

    families   the mistakes, each with the causes that describe it
    wrong      the suite's wrong cullers, as they are and as recordings of engines
    mutants    the published methods with one step broken
    cases      six faults of public reports, built anew
    catalogue  all of them
    drawn      which third of them is kept back
    table      judges them and counts
"""
