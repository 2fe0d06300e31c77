"""A contract for import-linter: some modules see those named, and nothing else of this project.

import-linter's own `forbidden` names what must not be imported, so a folder that comes later is
allowed until somebody thinks of it. Here it is the other way round.
"""

from __future__ import annotations

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class SeesOnlyContract(Contract):
    """Kept where all that `importers` import, at first hand or through others, is below one of
    `allowed` or of `importers`. A name stands for a module and all below it.

    With `at_first_hand` what the imported modules import themselves is their own affair. Packages
    that are not this project's are not looked at.
    """

    importers = fields.SetField(subfield=fields.ModuleField())
    allowed = fields.SetField(subfield=fields.ModuleField())
    at_first_hand = fields.BooleanField(required=False, default=False)

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        importers = {module.name for module in self.importers}
        named = importers | {module.name for module in self.allowed}
        missing = sorted(named - graph.modules)
        if missing:
            raise ValueError(f"no such module: {', '.join(missing)}")
        sources = set().union(*({name} | graph.find_descendants(name) for name in importers))
        chains = []
        for source in sorted(sources):
            if self.at_first_hand:
                seen = graph.find_modules_directly_imported_by(source)
            else:
                seen = graph.find_upstream_modules(source)
            chains.extend(
                graph.find_shortest_chain(source, module)
                for module in sorted(seen)
                if not graph.is_module_squashed(module) and not _below(module, named)
            )
        return ContractCheck(kept=not chains, metadata={"chains": chains})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for chain in check.metadata["chains"]:
            output.print_error(" -> ".join(chain), bold=False)


def _below(module: str, names: set[str]) -> bool:
    """Whether a module is one of `names` or below one."""
    return any(module == name or module.startswith(f"{name}.") for name in names)
