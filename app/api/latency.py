"""How long every stage takes: the table of the last utterances (Fu 2011, table 5.2), live."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from app.api.schemas import Latency, LatencyEntry, SpeechCounts, StagePercentiles
from app.api.service import LoadedService
from app.stream.timing import stage_percentiles
from app.tts.voicebox import EngineCounts

router = APIRouter(tags=["latency"])


@router.get("/v1/latency")
async def latency(service: LoadedService) -> Latency:
    """Percentiles of every stage in milliseconds after the request, and the last utterances, the newest last."""
    # Read once: an utterance under way goes on reaching stages, and the two halves must tell of the same moment.
    read = [(entry, entry.timings.milliseconds()) for entry in service.streams.latency.utterances()]
    return Latency(
        speech=[_counts(each) for each in service.voicebox.counts()],
        stages={
            stage: StagePercentiles(**asdict(percentiles))
            for stage, percentiles in stage_percentiles(timings for _, timings in read).items()
        },
        utterances=[
            LatencyEntry(utterance=entry.utterance, characters=entry.characters, timings=dict(timings.items()))
            for entry, timings in read
        ],
    )


def _counts(each: EngineCounts) -> SpeechCounts:
    return SpeechCounts(engine=each.engine, **asdict(each.times), remembered=each.remembered, fallback=each.fallback)
