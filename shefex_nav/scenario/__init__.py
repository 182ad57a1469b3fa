"""Scenario files in human units -> checked models -> settings in SI.

quantity, block, of_settings     values with units; sections; sections made of classes of settings
schema, mission, vehicle, ...    the sections of a scenario
aboard, plugged                  the sections of instruments; plug-ins that a scenario names
surroundings                     models of gravity, air and wind
shipped, files, document         which file a name means; its text; its tree with places
layers, load, expand             files that extend each other; reading one; tables in files of their own
overriding, fields, partial      --set; fields by their path
trajectory, columns, data_table  a trajectory of others; columns of files, and what is in them
checks*                          sections against each other
params*, told, wanted_states     what world and computer get; what the computer is told otherwise; its states
disperse, drawn, laws            what a campaign draws, and whether a run could fly with it
sweeps                           values to try of some settings, and their combinations
messages, suggest, kind          words about what is wrong
"""
