// What a killed run goes on from, beside its frames.
//
//   checkpoint.bin   a mark, the run's input hash, the bytes of a Checkpoint, those of the simulation last, their CRC-32
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "meshing/run/record.h"

namespace testbed::meshing {

struct Checkpoint {
  std::string simulation;              ///< as it was saved
  Recorded recorded;                   ///< before the rows and frames of the step that it was saved after
  std::map<std::string, double> sums;  ///< of the record so far
};

/// Writes it to a temporary name and renames it.
void write_checkpoint(const std::filesystem::path& folder, const std::string& input_hash,
                      Checkpoint checkpoint);

/// That of a run of these inputs, if it is whole and its frames are there as they were written.
std::optional<Checkpoint> stored_checkpoint(const std::filesystem::path& folder,
                                            const std::string& input_hash);

}  // namespace testbed::meshing
