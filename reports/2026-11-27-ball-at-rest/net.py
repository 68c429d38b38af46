#!/usr/bin/env python3
"""Net goals per minute of one arm without and with the price, over the policies of several transfer.json; Welch's t-test.

    python net.py ARM WITHOUT.json ... -- WITH.json ...
"""

import json
import sys

import numpy as np
from scipy import stats

arm, *files = sys.argv[1:]
border = files.index("--")
groups = []
for group in (files[:border], files[border + 1 :]):
    documents = [json.load(open(file)) for file in group]
    groups.append(np.concatenate([own["arms"][arm]["all"]["net_goals_per_min_by_seed"] for own in documents]))
without, price = groups
test = stats.ttest_ind(price, without, equal_var=False)
low, high = test.confidence_interval()
print(f"{arm}: without {np.round(without, 2)} mean {without.mean():.2f}, with {np.round(price, 2)} mean {price.mean():.2f}")
print(f"difference {price.mean() - without.mean():.2f} ({low:.2f} to {high:.2f}), p = {test.pvalue:.2g}")
