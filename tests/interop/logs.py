"""Writes one log with pandas, polars and pyarrow in many formats to the directory that is named, and prints as JSON what each
file contains: the options that it needs, and its rows. Times are by the clock of Europe/Berlin unless they are in UTC."""

import datetime
import json
import os
import sys

import pandas
import polars
import pyarrow
import pyarrow.csv
import pyarrow.parquet

os.chdir(sys.argv[1])
bed = [20.125, 20.25, 20.5, 1020.75, 21.0]
air = [19.5, None, 19.75, 19.875, 20.0]
first = datetime.datetime(2026, 3, 9, 6)
times = [first + datetime.timedelta(seconds=60 * row) for row in range(len(bed))]
frame = pandas.DataFrame({"time": pandas.to_datetime(times), "bed": bed, "air": air})
table = polars.DataFrame({"time": times, "bed": bed, "air": air})
logs = {}


def log(name, *options):
    logs[name] = list(options)
    return name


frame.to_csv(log("pandas.csv"), index=False)
german = frame.rename(columns={"time": "Datum & Uhrzeit", "bed": "bed [°C]", "air": "air [°C]"})
german.to_csv(
    log("pandas_german.csv"), index=False, sep=";", decimal=",", date_format="%d.%m.%Y %H:%M:%S", encoding="cp1252"
)
frame.to_csv(
    log("pandas_american.csv", "--dates", "month-first"), index=False, date_format="%m/%d/%Y %I:%M:%S %p"
)
frame.to_csv(log("pandas_utf16.csv"), index=False, sep="\t", encoding="utf-16")
frame.to_csv(log("pandas.csv.gz"), index=False)
frame.to_excel(log("pandas.xlsx"), index=False)
frame.melt(id_vars="time", var_name="sensor").to_csv(log("pandas_long.csv"), index=False)
parts = frame.assign(Date=frame["time"].dt.strftime("%Y/%m/%d"), Time=frame["time"].dt.strftime("%H:%M:%S"))
parts[["Date", "Time", "bed", "air"]].to_csv(log("pandas_date_and_time.csv"), index=False)
frame.astype({"time": "datetime64[ns]"}).to_parquet(log("pandas_ns.parquet"), index=False)
frame.set_index("time").to_parquet(log("pandas_index.parquet"))
frame.assign(time=frame["time"].dt.tz_localize("Europe/Berlin")).to_parquet(log("pandas_zone.parquet"), index=False)

table.write_csv(log("polars.csv"))
table.write_parquet(log("polars.parquet"))
parts = table.with_columns(Date=polars.col("time").dt.date(), Time=polars.col("time").dt.time()).drop("time")
parts.write_parquet(log("polars_date_and_time.parquet"))

arrow = pyarrow.table({"time": pyarrow.array(times, pyarrow.timestamp("ms")), "bed": bed, "air": air})
pyarrow.csv.write_csv(arrow, log("pyarrow.csv"))
with pyarrow.parquet.ParquetWriter(log("pyarrow_groups.parquet"), arrow.schema) as writer:
    for part in [arrow.slice(0, 0), arrow.slice(0, 2), arrow.slice(2, 0), arrow.slice(2)]:
        writer.write_table(part)

utc = [(at - datetime.timedelta(hours=1)).strftime("%Y-%m-%dT%H:%M:%SZ") for at in times]
json.dump({"logs": logs, "time": utc, "bed": bed, "air": air}, sys.stdout)
