"""How a navigation stands wrong data sheets and faults: many flights over a covering design, judged.

`design` has the table of the cells, `factors` and `happenings` say what its levels mean;
`flight` flies one of them with its twin, in which nothing happens (together, until something differs),
`detect` says from which instant on the fault could be noticed, `assess` what the solution
was worth; `store` keeps flights, `running` hands them to workers, `cells` sums up, `require` holds the sums
against what is required, `show` and `page` print them; `random_faults` draws missions beside the design.
"""
