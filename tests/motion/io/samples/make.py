"""Make the samples of DeepLabCut's tables: pandas and PyTables write them, which the tests do without.

pip install pandas tables && python make.py && gzip -9 -n *.h5
"""

import numpy as np
import pandas as pd

rng = np.random.default_rng(0)


def table(several: bool) -> pd.DataFrame:
    """Four frames of one animal or two; a point of the third is no number, beside a likelihood of 1."""
    animals = [["mouse1", "mouse2"]] if several else []
    names = ["scorer", "individuals", "bodyparts", "coords"] if several else ["scorer", "bodyparts", "coords"]
    columns = pd.MultiIndex.from_product([["net"], *animals, ["knee", "foot"], ["x", "y", "likelihood"]], names=names)
    values = np.round(rng.uniform(0, 100, (4, len(columns))), 2)
    values[:, 2::3] = 0.5
    values[2, :3] = [np.nan, np.nan, 1.0]
    return pd.DataFrame(values, columns=columns, index=range(4))


for several in (False, True):
    for form in ("table", "fixed"):
        frame, name = table(several), f"dlc_{'several' if several else 'one'}_{form}"
        frame.to_hdf(f"{name}.h5", key="df_with_missing", format=form, mode="w")
        frame.to_csv(f"{name}.csv")
