"""Programs of a machine as production jobs, in its ProductionPlan (OPC 40501-1, ProductionJobListType)."""

from __future__ import annotations

from datetime import datetime

from asyncua import ua
from mcclient import MachineStatus

from mcserver.opcua.nodes import MachineNodes
from mcserver.opcua.readings import job_readings, jobs_of

JOB_TYPE, PROGRAM_TYPE = 29, 59
PLAN = "Production.ProductionPlan"


class ProductionPlan:
    """Jobs that are shown: programs that have not ended, and those that ended a moment ago."""

    def __init__(self, nodes: MachineNodes) -> None:
        self._nodes = nodes
        self._shown: set[str] = set()

    async def show(self, status: MachineStatus | None, time: datetime) -> None:
        """Add jobs that are new, remove those that are over, and write what has changed.

        Args:
            status: None: the machine does not answer, and nothing is known of its jobs.
        """
        jobs = [] if status is None else jobs_of(status)
        for gone in self._shown - {each.program for each in jobs}:
            await self._nodes.remove(f"{PLAN}.{gone}")
            self._shown.remove(gone)
        for number, job in enumerate(jobs):
            path = f"{PLAN}.{job.program}"
            if job.program not in self._shown:
                await self._add(path, job.program)
                self._shown.add(job.program)
            found = job_readings(job, number, self._nodes.model.job_states)
            await self._nodes.show({f"{path}.{name}": value for name, value in found.items()}, time)

    async def _add(self, path: str, name: str) -> None:
        nodes = self._nodes
        own, kind = ua.QualifiedName(name, nodes.model.own), nodes.model.type(JOB_TYPE)
        await nodes.add(nodes.node(PLAN), path, own, kind)
        programs = f"{path}.ProductionPrograms"
        # asyncua takes the type's placeholder of a program for one
        await nodes.server.delete_nodes(await nodes.node(programs).get_children(), recursive=True)
        program = ua.QualifiedName("Program", nodes.model.own)
        await nodes.add(nodes.node(programs), f"{programs}.Program", program, nodes.model.type(PROGRAM_TYPE))
