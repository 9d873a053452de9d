"""How long every stage takes: the table of the last utterances (Fu 2011, table 5.2), live."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from app.api.schemas import Latency, LatencyEntry, StagePercentiles
from app.api.service import LoadedService

router = APIRouter(tags=["latency"])


@router.get("/v1/latency")
async def latency(service: LoadedService) -> Latency:
    """Percentiles of every stage in milliseconds after the request, and the last utterances, the newest last."""
    log = service.streams.latency
    return Latency(
        stages={stage: StagePercentiles(**asdict(percentiles)) for stage, percentiles in log.stages().items()},
        utterances=[
            LatencyEntry(
                utterance=entry.utterance,
                characters=entry.characters,
                timings=dict(entry.timings.milliseconds().items()),
            )
            for entry in log.utterances()
        ],
    )
