// What a run leaves on disk, the same for both solvers: frames, curves and a record of how it was made.
//
//   frames.pvd                  the frames and their times, as they are written
//   frames/frame_000000.vtu ... deformed points; field data TimeValue (s) and n_surface;
//                               point data displacement (m), velocity (m/s), node_id;
//                               cells: the surface triangles first, then springs or tetrahedra
//   frames/frame_000000.pvtu ... of several processes in their place: a list of pieces frame_000000_0.vtu and on, of which
//                               the first has the surface; node_id is a node's number in the whole mesh
//   curves.csv                  one row per step, as it is taken; named columns, SI units
//   run.json                    written last: a folder without it is not a result; its `outputs` name each of these
//                               files with its bytes and its CRC-32
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <fstream>
#include <future>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "meshing/base/snapshot.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "meshing/tetrahedra/tetrahedralize.h"

namespace testbed::meshing {

/// Cells of one VTK type (VTK_LINE 3, VTK_TRIANGLE 5, VTK_TETRA 10, VTK_QUADRATIC_TETRA 24).
struct CellBlock {
  int vtk_type;
  Eigen::MatrixXi nodes;  ///< nodes per cell x n_cells
};

/// Writes an unstructured grid (.vtu, raw appended, zlib) to a temporary name and renames it. Point data
/// node_id (integers; empty: 0, 1, ...) is added to the given fields.
/// @return what was written
/// @throws std::runtime_error when a value is not finite or the file cannot be written.
std::string write_vtu(const std::filesystem::path& file, const Eigen::Matrix3Xd& points,
                      const std::vector<CellBlock>& cells, const std::vector<Field>& point_fields,
                      const std::map<std::string, double>& field_data, const std::vector<int>& node_id = {});

/// What one of several processes writes of every frame.
struct Piece {
  int n_pieces = 1, number = 0;
  std::vector<int> node_id = {};  ///< of its nodes, in the whole mesh; empty: the same
};

/// Writes the list (.pvtu) of a frame's pieces, which write_vtu has made, and returns it.
std::string write_pvtu(const std::filesystem::path& file, const std::vector<std::string>& pieces,
                       const std::vector<Field>& point_fields);

/// What a run has left so far.
struct Recorded {
  std::vector<std::pair<double, std::string>> frames;  ///< their times and names
  std::vector<std::string> columns;
  std::string rows;                                                   ///< of curves.csv
  nlohmann::ordered_json outputs = nlohmann::ordered_json::object();  ///< name -> bytes and CRC-32
};

constexpr const char* kCheckpointFile = "checkpoint.bin";

/// How a run ends that reaches its budget: it is never up to date.
constexpr const char* kStoppedEarly = "stopped_early";

/// Whether the frames are in the folder as they were written.
bool are_frames_whole(const std::filesystem::path& folder, const Recorded& recorded);

/// Removes the files of an older run from a folder, and no others, but for what a run goes on from: these frames, and a
/// checkpoint. run.json goes first: what is left of an interrupted removal is no result.
void remove_run(const std::filesystem::path& folder, const Recorded* kept = nullptr);

/// Writes frames and curves of one run into a folder, and run.json when it is finished.
class Recorder {
 public:
  /// Removes an older run, but for what this one goes on from. `cells` are those of every frame, surface triangles first.
  /// @param piece  of several processes each has a recorder, and the first alone curves and run.json
  Recorder(std::filesystem::path folder, std::vector<CellBlock> cells, int n_surface,
           const Recorded* before = nullptr, Piece piece = {});

  /// @throws std::runtime_error as add_frame
  const Recorded& recorded();

  /// Adds a frame: time (s), rest points X and displacement u (3 x n, m), further fields as given. A thread of its own
  /// compresses and writes it, while the next steps are taken.
  /// @throws std::runtime_error when a value of the frame before is not finite or it cannot be written; it is not added.
  void add_frame(double time, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& u,
                 const std::vector<Field>& fields = {});

  /// Adds a row to curves.csv. Of what a row does not name, as an event took it away or will bring it, it has zero.
  /// @throws std::runtime_error when a value is not finite.
  void add_row(const std::vector<std::pair<std::string, double>>& row);

  /// Writes curves.csv if it has rows and, last of all, run.json, with the largest memory of the run (byte) and the list
  /// of all files, to which the record's own `outputs` belong. A checkpoint is left to a run that was stopped early alone.
  void finish(nlohmann::ordered_json record);

 private:
  void end_frame();
  size_t column(const std::string& name);

  std::filesystem::path folder_;
  std::vector<CellBlock> cells_;
  int n_surface_;
  Piece piece_;
  Recorded recorded_;
  std::ofstream list_, curves_;           ///< frames.pvd and curves.csv, for those who watch
  std::pair<double, std::string> frame_;  ///< time and name of the one that is being written
  std::future<nlohmann::ordered_json>
      is_written_;  ///< gives the stamps of its files; last: its thread sees all of the above
};

/// Largest resident memory of this process so far (byte); unlike getrusage's, not that of who started it.
double peak_memory();

/// What is the same in every run.json: program, versions, compiler and flags, machine, date.
/// @param n_threads  that the solve may use, as only the program knows
nlohmann::ordered_json environment_record(const std::string& program, int n_threads);

/// The measures by their names.
nlohmann::ordered_json to_json(const TetQuality& quality);
/// The mesher that filled the surface and what others before it said.
nlohmann::ordered_json to_json(const TetReport& report);

/// The record of the finished run in `folder`, however it ended but early, if it has this input hash and every file that
/// it lists is there as it was written.
std::optional<nlohmann::ordered_json> stored_record(const std::filesystem::path& folder,
                                                    const std::string& input_hash);

}  // namespace testbed::meshing
