"""What the figures of a report are, in words."""

from __future__ import annotations

__all__ = ["DEFINITIONS"]

DEFINITIONS: dict[str, str] = {
    "ap": "Average precision: the mean over forty levels of recall, 1/40 to 1, of the best "
    "precision at that recall or above (Simonelli et al. 2019). Detections are taken by falling "
    "score; each finds the best object that meets the criterion and that none found before.",
    "bev_iou, iou_3d": "Intersection over union of the boxes, in plan and in space.",
    "within": "Distance of the centres in plan.",
    "ap_nuscenes": "The same detections by nuScenes' definition (Caesar et al. 2020): precision "
    "interpolated at 101 levels of recall, above 10 % of recall, as far as it is above 10 %.",
    "ci95": "2.5th to 97.5th percentile of draws of frames with replacement, neighbours together "
    "where they show the same objects (moving blocks, Künsch 1989). Frames of one hour and place "
    "say nothing of other places.",
    "not counted": "Neither help nor hurt: objects with too few points, marked as ignored, or of a "
    "class that is not told apart. A detection that meets the criterion with one, or that lies in "
    "it by half, is left out. So is one outside of what is labelled that finds nothing.",
    "distinct": "Objects counted once however many frames show them: by their tracks, else those "
    "that stand at the same place in the next frame.",
    "best_f1": "At the threshold of the score with the best F1, chosen on these very labels: an "
    "upper bound. By distance: 2 m for trucks, buses and large, 1 m for the others.",
    "found": "Share of the objects that are found at that threshold.",
    "by range, points, hidden": "Objects of other bins neither help nor hurt; wrong detections are "
    "those of the same range, or with as many points in them; for hidden objects all.",
    "errors": "Of detections within 2 m in plan, at any score. ATE: distance of centres in plan; "
    "ASE: 1 - IoU after centres and headings are laid on each other; AOE: smallest difference of "
    "yaw (nuScenes; Argoverse 2 has another ASE). Signed ones are found less labelled, along the "
    "labelled heading.",
    "HOTA, DetA, AssA": "How well objects are found and followed (Luiten et al. 2021), the mean "
    "over 19 similarities. Boxes are as similar as centres are near in plan: 0.5 at 1 m (trucks, "
    "buses, large: 2 m), 0 twice as far. At the threshold of the best F1, as MOTA and IDF1.",
    "MOTA, swaps": "1 less the misses, wrong boxes and swaps of tracks over the objects, of all "
    "frames, at a similarity of 0.5 (Bernardin and Stiefelhagen 2008).",
    "IDF1": "F1 of boxes whose whole tracks are assigned to each other (Ristani et al. 2016).",
    "IoU of points": "Of each class the points rightly said to be of it over those that are or are "
    "said to be (SemanticKITTI, Behley et al. 2019), over all frames; unlabelled points and those "
    "beyond the model's range do not count. The mean is over the classes that are labelled.",
    "false alarms": "Wrong detections at or above the threshold of the best F1. Standing ones come "
    "within 1 m of the same place in half of the frames or more: posts, signs, hedges.",
}
